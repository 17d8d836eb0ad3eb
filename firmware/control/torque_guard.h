/**
 * The last step on the way to the motor: one pure function that cuts the torque to what is allowed,
 * and says why.
 *
 * |torque| <= ramp x TA; |torque| <= max(T_max now, latched f_max); nothing outward at or beyond a
 * position limit; not a number becomes 0. Rounds to whole mN m last.
 */
#ifndef TORQUE_GUARD_H
#define TORQUE_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "control/number.h"

/** Ramp at its end. */
#define TORQUE_GUARD_RAMP_FULL 1000000U

/** Why the torque is lower than asked: bits of object 2200h. */
#define LIMIT_REASON_BOUND_RAMP 0x0001U
#define LIMIT_REASON_TORQUE_LIMIT 0x0002U /**< TA */
#define LIMIT_REASON_TORQUE_MAX 0x0004U   /**< T_max now or latched f_max */
#define LIMIT_REASON_POSITION_LIMIT 0x0008U
#define LIMIT_REASON_NOT_A_NUMBER 0x0010U
#define LIMIT_REASON_HALT 0x0020U

typedef struct {
    torque_t torque_Nm;       /**< asked for */
    torque_t torque_limit_Nm; /**< TA */
    uint32_t ramp_ppm;        /**< 0..TORQUE_GUARD_RAMP_FULL */
    torque_t torque_max_Nm;   /**< T_max of this tick */
    torque_t f_max_Nm;        /**< latched by the FIC */
    int32_t position_inc;
    int32_t position_min_inc;
    int32_t position_max_inc;
} torque_guard_input_t;

typedef struct {
    int16_t torque_mNm;
    uint16_t reasons;
} torque_guard_output_t;

/** The torque for the motor, -32767..32767 mN m, and the reasons for every cut. */
torque_guard_output_t torque_guard(const torque_guard_input_t *input);

#endif
