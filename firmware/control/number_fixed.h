/**
 * Numbers of the control law as 32-bit integers with 64-bit intermediates, for processors without
 * floating point. To be included by number.h only.
 *
 * | type         | unit         | range used           | step         |
 * | angle_t      | 2^-29 rad    | +-1 rad (of +-4)     | 1.9e-9 rad   |
 * | torque_t     | 2^-16 N m    | +-32.8 N m (+-32768) | 15.3 uN m    |
 * | angle_step_t | 2^-61 rad    | 0..0.025 rad         | 4e-19 rad    |
 *
 * Every function rounds once, half away from zero, and saturates to +-INT32_MAX: for arguments in
 * the ranges stated nothing wraps, and INT32_MIN as an argument does no harm. Source of the
 * formats and what they cost: docs/fixed_point.md.
 */
#ifndef NUMBER_FIXED_H
#define NUMBER_FIXED_H

#include <stdbool.h>
#include <stdint.h>

typedef int32_t angle_t;       /**< 2^-29 rad */
typedef uint64_t angle_step_t; /**< 2^-61 rad */
typedef int32_t torque_t;      /**< 2^-16 N m */

/** How a difference of positions becomes an angle. One step = 1 increment / parts. */
typedef struct {
    int32_t limit_steps; /**< 0.5 rad */
    angle_step_t step_rad;
} angle_scale_t;

/** At most INT32_MAX in size. */
static inline int32_t number_saturated(int64_t value) {
    return (int32_t)(value > INT32_MAX ? INT32_MAX : value < -INT32_MAX ? -INT32_MAX : value);
}

/** |value|; value > INT64_MIN */
static inline uint64_t number_size(int64_t value) {
    return (uint64_t)(value < 0 ? -value : value);
}

/** +-dividend / divisor. dividend <= 2^63, 0 < divisor < 2^63 */
static inline int32_t number_ratio(bool negative, uint64_t dividend, uint64_t divisor) {
    const uint64_t ratio = (dividend + divisor / 2U) / divisor;
    const int64_t size = ratio < (uint64_t)INT32_MAX ? (int64_t)ratio : INT32_MAX;
    return (int32_t)(negative ? -size : size);
}

/** increments_per_revolution 256..2^24, parts 1..256 */
static inline angle_scale_t angle_scale(uint32_t increments_per_revolution, uint32_t parts) {
    const uint64_t revolution_2p61 = 0xC90FDAA22168C235U; /* 2 pi */
    const uint64_t steps = (uint64_t)increments_per_revolution * parts;
    const angle_scale_t scale = {.limit_steps = angle_limit_steps(increments_per_revolution, parts),
                                 .step_rad = revolution_2p61 /
                                             steps}; /* at the limit 2^-29 of a unit too little */
    return scale;
}

/** Steps of 1/parts increment as an angle, saturated to +-0.5 rad. */
static inline angle_t angle_from_steps(const angle_scale_t *scale, int64_t steps) {
    const int32_t limit = scale->limit_steps;
    const int64_t kept = steps > limit ? limit : steps < -limit ? -limit : steps;
    const uint64_t size_2p61 = number_size(kept) * scale->step_rad; /* <= 0.5 rad: no overflow */
    return number_ratio(kept < 0, size_2p61, (uint64_t)1 << 32);
}

/** step * part / whole, with whole > 0. */
static inline angle_t angle_part(angle_step_t step_rad, uint16_t part, uint16_t whole) {
    const uint64_t step_2p45 = step_rad >> 16; /* room for the product */
    return number_ratio(false, step_2p45 * part, (uint64_t)whole << 16);
}

/** 0..3999999 urad exactly rounded, more saturates. */
static inline angle_t angle_from_urad(uint32_t angle_urad) {
    return number_ratio(false, (uint64_t)angle_urad << 29, 1000000U);
}

/** a + b */
static inline angle_t angle_sum(angle_t a, angle_t b) {
    return number_saturated((int64_t)a + b);
}

/** a - b */
static inline angle_t angle_difference(angle_t a, angle_t b) {
    return number_saturated((int64_t)a - b);
}

/** |angle| */
static inline angle_t angle_abs(angle_t angle) {
    return number_saturated(angle < 0 ? -(int64_t)angle : angle);
}

/** torque_mNm / parts, as a torque. parts > 0 */
static inline torque_t torque_from_mNm(int32_t torque_mNm, uint32_t parts) {
    return number_ratio(torque_mNm < 0, number_size(torque_mNm) << 16, (uint64_t)1000U * parts);
}

/** torque * numerator / denominator; exactly torque where both are equal. denominator > 0 */
static inline torque_t torque_scaled(torque_t torque, angle_t numerator, angle_t denominator) {
    const int64_t product = (int64_t)torque * numerator;
    return number_ratio(product < 0, number_size(product), (uint64_t)denominator);
}

/** slope * elapsed. elapsed_us 0..1000000 */
static inline torque_t torque_from_slope(uint32_t slope_mNm_s, uint32_t elapsed_us) {
    const uint64_t torque_nNm = (uint64_t)slope_mNm_s * elapsed_us; /* below 2^52 */
    return number_ratio(false, torque_nNm << 7, 1953125U);          /* 2^16 / 10^9 */
}

/** torque * part / whole, with whole > 0; exactly torque where both are equal. */
static inline torque_t torque_part(torque_t torque, uint32_t part, uint32_t whole) {
    return number_ratio(torque < 0, number_size(torque) * part, whole);
}

/** a + b */
static inline torque_t torque_sum(torque_t a, torque_t b) {
    return number_saturated((int64_t)a + b);
}

/** a - b */
static inline torque_t torque_difference(torque_t a, torque_t b) {
    return number_saturated((int64_t)a - b);
}

/** -torque */
static inline torque_t torque_negated(torque_t torque) {
    return number_saturated(-(int64_t)torque);
}

/** |torque| */
static inline torque_t torque_abs(torque_t torque) {
    return torque < 0 ? torque_negated(torque) : torque;
}

/** The lesser one. */
static inline torque_t torque_min(torque_t a, torque_t b) {
    return a < b ? a : b;
}

/** The greater one. */
static inline torque_t torque_max(torque_t a, torque_t b) {
    return a > b ? a : b;
}

/** bound >= 0 */
static inline torque_t torque_clamp(torque_t torque, torque_t bound) {
    return torque > bound ? bound : torque < -(int64_t)bound ? torque_negated(bound) : torque;
}

/** Here always: there is no other value. */
static inline bool torque_is_number(torque_t torque) {
    (void)torque;
    return true;
}

/** Whole mN m, rounded half away from zero, saturated to +-32767. */
static inline int16_t torque_to_mNm(torque_t torque) {
    const int32_t torque_mNm =
        number_ratio(torque < 0, number_size(torque) * 1000U, (uint64_t)1 << 16);
    return (int16_t)(torque_mNm > INT16_MAX    ? INT16_MAX
                     : torque_mNm < -INT16_MAX ? -INT16_MAX
                                               : torque_mNm);
}

#endif
