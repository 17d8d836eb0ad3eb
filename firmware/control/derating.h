/**
 * How much of the torque limit TA is left: less of it as the motor gets hot, as its mean square
 * current exceeds the rated one, and as it comes near its highest speed.
 *
 * Each share falls linearly from 1 to 0, in steps of 1/2048; the least of them counts. Speed
 * derates the torque in the direction of motion only, so that braking keeps all of it. A motor that
 * is cool, lightly loaded and slow costs three comparisons; no share costs a division of 64 bits.
 */
#ifndef DERATING_H
#define DERATING_H

#include <stdbool.h>
#include <stdint.h>

/** Share at its full. */
#define DERATING_FULL 2048

/** A load of 1, a speed of 1: rated, highest. */
#define DERATING_WHOLE_ppm 1000000U

/** Why the torque is lower than asked: bits of object 2200h, beside those of torque_guard.h. */
#define LIMIT_REASON_TEMPERATURE 0x0040U
#define LIMIT_REASON_CURRENT 0x0080U
#define LIMIT_REASON_SPEED 0x4000U

typedef struct {
    int16_t temperature_dC;
    int16_t temperature_begin_dC; /**< full up to here */
    int16_t temperature_end_dC;   /**< nothing from here on */
    uint32_t load_ppm;  /**< see derating_load; full up to 1000000, nothing from twice it on */
    uint32_t speed_ppm; /**< of the highest speed */
    uint32_t speed_begin_ppm; /**< full up to here, nothing from 1000000 on; below 1000000 */
} derating_input_t;

typedef struct {
    int16_t share;    /**< 0..DERATING_FULL */
    uint16_t reasons; /**< of every share below the full */
} derating_output_t;

/** Whether any share is below the full; if not, as nearly always, derating need not be asked. */
static inline bool derating_applies(const derating_input_t *input, bool accelerates) {
    return input->temperature_dC > input->temperature_begin_dC ||
           input->load_ppm > DERATING_WHOLE_ppm ||
           (accelerates && input->speed_ppm > input->speed_begin_ppm);
}

/** The share of the torque limit that may be used: the least of those by temperature, load and
 * speed. accelerates: the torque has the sign of the speed. */
derating_output_t derating(const derating_input_t *input, bool accelerates);

/** Mean square of the current with a time constant; saturates at the square of UINT32_MAX / 1000.
 */
uint64_t derating_mean_square(uint64_t mean_square_mA2, uint32_t current_mA, uint32_t time_us,
                              uint32_t elapsed_us);

/** Mean square of the current as a part of the rated current's square, in ppm; saturates at
 * 4294967295. A rated current of zero counts as 1 mA. */
uint32_t derating_load(uint64_t mean_square_mA2, uint32_t rated_current_mA);

#endif
