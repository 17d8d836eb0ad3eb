/**
 * Homing (CiA 402-2, mode 6): methods 33 and 34 move the joint until the encoder's index pulse, 37
 * takes the present position.
 *
 * A search moves a desired position at constant speed; whoever drives it follows that and reports
 * the index pulse. The desired position never leads the joint by more than lead_inc, so that a
 * joint that is held up does not jump when it comes free.
 */
#ifndef HOMING_H
#define HOMING_H

#include <stdbool.h>
#include <stdint.h>

#define HOMING_INDEX_NEGATIVE 33
#define HOMING_INDEX_POSITIVE 34
#define HOMING_HERE 37

typedef struct {
    int8_t method;        /**< 6098h */
    uint32_t speed_inc_s; /**< 6099h:02 */
    uint32_t time_out_us;
    uint32_t lead_inc;
} homing_config_t;

typedef enum {
    HOMING_NOT_STARTED,
    HOMING_SEARCHING,
    HOMING_ATTAINED,
    HOMING_INTERRUPTED, /**< its start bit was taken back, or halt */
    HOMING_FAILED       /**< no index pulse in time */
} homing_phase_t;

typedef struct {
    homing_phase_t phase;
    int32_t target_inc;
    uint32_t rest; /**< of the target's motion, in 1e-6 inc */
    uint32_t since_us;
} homing_t;

/** Begins; HOMING_HERE has attained its home at once. */
void homing_start(const homing_config_t *config, int32_t position_inc, homing_t *homing);

/** Lets node time pass in a search. */
void homing_step(const homing_config_t *config, int32_t position_inc, uint32_t elapsed_us,
                 homing_t *homing);

/** Bits 10, 12 and 13 of the statusword. */
uint16_t homing_statusword(bool referenced, bool moving, const homing_t *homing);

#endif
