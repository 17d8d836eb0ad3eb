/**
 * The last step on the way to the motor: one pure function that cuts the torque to what is allowed,
 * and says why.
 *
 * In this order: not a number becomes 0; the torque moves from that of the tick before by no more
 * than the torque slope (6087h), where that is set; |torque| <= max(T_max now, latched f_max);
 * |torque| <= TA, derated (derating.h); |torque| <= ramp x derated TA; nothing outward at or beyond
 * a position limit. The bounds come after the slope: a torque that has to go is not kept by it.
 * Rounds to whole mN m last.
 *
 * Torque slope: CiA 402-2, object 6087h. It is exact to one step of torque_t in each tick.
 */
#ifndef TORQUE_GUARD_H
#define TORQUE_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "control/derating.h"
#include "control/number.h"

/** Ramp at its end. */
#define TORQUE_GUARD_RAMP_FULL 1000000U

/** Object 6087h: the torque may jump. */
#define TORQUE_GUARD_SLOPE_OFF 0xFFFFFFFFU

/** Why the torque is lower than asked: bits of object 2200h, beside those of derating.h. */
#define LIMIT_REASON_BOUND_RAMP 0x0001U
#define LIMIT_REASON_TORQUE_LIMIT 0x0002U /**< TA */
#define LIMIT_REASON_TORQUE_MAX 0x0004U   /**< T_max now or latched f_max */
#define LIMIT_REASON_POSITION_LIMIT 0x0008U
#define LIMIT_REASON_NOT_A_NUMBER 0x0010U
#define LIMIT_REASON_HALT 0x0020U
/** The 16 bits are taken; with the ramp it shares that the torque is still on its way. */
#define LIMIT_REASON_TORQUE_SLOPE LIMIT_REASON_BOUND_RAMP

typedef struct {
    torque_t torque_Nm;        /**< asked for */
    torque_t torque_before_Nm; /**< output of the tick before, 0 where there was none */
    uint32_t elapsed_us;       /**< since the tick before, 0..1000000 */
    uint32_t slope_mNm_s;      /**< 1000..4294967294, or TORQUE_GUARD_SLOPE_OFF */
    torque_t torque_limit_Nm;  /**< TA */
    uint32_t ramp_ppm;         /**< 0..TORQUE_GUARD_RAMP_FULL */
    torque_t torque_max_Nm;    /**< T_max of this tick */
    torque_t f_max_Nm;         /**< latched by the FIC */
    int32_t position_inc;
    int32_t position_min_inc;
    int32_t position_max_inc;
    int8_t moving; /**< direction of the motion, -1, 0, 1 */
    derating_input_t motor;
} torque_guard_input_t;

typedef struct {
    torque_t torque_Nm; /**< before rounding: torque_before_Nm of the next tick */
    int16_t torque_mNm;
    uint16_t reasons;
} torque_guard_output_t;

/** The torque for the motor, -32767..32767 mN m, and the reasons for every cut. */
torque_guard_output_t torque_guard(const torque_guard_input_t *input);

#endif
