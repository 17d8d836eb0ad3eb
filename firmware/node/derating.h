/**
 * How much of the torque limit TA is left: less of it as the motor gets hot, as its mean square
 * current exceeds the rated one, and as it comes near its highest speed.
 *
 * Each share falls linearly from 1 to 0; the least of them counts. Speed derates the torque in the
 * direction of motion only, so that braking keeps all of it.
 */
#ifndef DERATING_H
#define DERATING_H

#include <stdbool.h>
#include <stdint.h>

/** Share at its full. */
#define DERATING_FULL_ppm 1000000U

/** Why the torque is lower than asked: bits of object 2200h, beside those of torque_guard.h. */
#define LIMIT_REASON_TEMPERATURE 0x0040U
#define LIMIT_REASON_CURRENT 0x0080U
#define LIMIT_REASON_SPEED 0x4000U

typedef struct {
    int16_t temperature_dC;
    int16_t temperature_begin_dC; /**< full up to here */
    int16_t temperature_end_dC;   /**< nothing from here on */
    uint64_t mean_square_mA2;
    uint32_t rated_current_mA; /**< full up to its square, nothing from twice that on */
    uint32_t speed_ppm;        /**< of the highest speed */
    uint32_t speed_begin_ppm;  /**< full up to here, nothing from 1000000 on; below 1000000 */
    bool torque_accelerates;   /**< it has the sign of the speed */
} derating_input_t;

typedef struct {
    uint32_t share_ppm; /**< 0..DERATING_FULL_ppm */
    uint16_t reasons;   /**< of every share below the full */
} derating_output_t;

/** The share of the torque limit that may be used: the least of those by temperature, current and
 * speed. */
derating_output_t derating(const derating_input_t *input);

/** Mean square of the current with a time constant; saturates at the square of UINT32_MAX / 1000.
 */
uint64_t derating_mean_square(uint64_t mean_square_mA2, uint32_t current_mA, uint32_t time_us,
                              uint32_t elapsed_us);

#endif
