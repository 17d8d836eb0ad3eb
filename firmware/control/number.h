/**
 * The numbers of the control law: angles in rad, torques in N m, and the few operations on them
 * that the law needs. The law itself is written once; two builds give these names their meaning:
 *
 * - float (default): IEEE single, see number_float.h;
 * - fixed (CONTROL_FIXED_POINT defined): 32-bit integers, see number_fixed.h and
 *   docs/fixed_point.md.
 *
 * In both, a position never becomes a number; only the difference of two positions does, after it
 * was formed exactly in integers and saturated to +-0.5 rad. Torques leave as whole mN m, rounded
 * half away from zero, saturated to +-32767.
 *
 * An angle or a torque of zero may be written 0. All other arithmetic goes through the functions:
 * plain operators would wrap in the fixed build.
 */
#ifndef NUMBER_H
#define NUMBER_H

#include <stdint.h>

/**
 * 0.5 rad in steps of 1/parts increment, rounded down: the limit of angle_from_steps.
 * increments_per_revolution 256..2^24, parts 1..256.
 */
static inline int32_t angle_limit_steps(uint32_t increments_per_revolution, uint32_t parts) {
    const uint64_t per_half_radian_2p36 = 5468522205U; /* 2^36 / (4 pi) */
    return (int32_t)(((uint64_t)increments_per_revolution * parts * per_half_radian_2p36) >> 36);
}

#ifdef CONTROL_FIXED_POINT
#include "control/number_fixed.h"
#else
#include "control/number_float.h"
#endif

#endif
