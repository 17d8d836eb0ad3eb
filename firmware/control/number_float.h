/**
 * Numbers of the control law as IEEE single: no double, no fused operations. To be included by
 * number.h only.
 *
 * Angles and torques are floats in rad and N m, rounded to nearest: an angle is good to 4e-7 of
 * itself. A division by zero or not-a-number input gives NaN, which torque_is_number finds.
 */
#ifndef NUMBER_FLOAT_H
#define NUMBER_FLOAT_H

#include <stdbool.h>
#include <stdint.h>

typedef float angle_t;      /**< rad */
typedef float angle_step_t; /**< rad */
typedef float torque_t;     /**< N m */

/** How a difference of positions becomes an angle. One step = 1 increment / parts. */
typedef struct {
    int32_t limit_steps; /**< 0.5 rad */
    angle_step_t step_rad;
} angle_scale_t;

/** increments_per_revolution 256..2^24, parts 1..256 */
static inline angle_scale_t angle_scale(uint32_t increments_per_revolution, uint32_t parts) {
    const uint64_t steps = (uint64_t)increments_per_revolution * parts;
    const angle_scale_t scale = {.limit_steps = angle_limit_steps(increments_per_revolution, parts),
                                 .step_rad = 6.2831853f / (float)steps};
    return scale;
}

/** Steps of 1/parts increment as an angle, saturated to +-0.5 rad. */
static inline angle_t angle_from_steps(const angle_scale_t *scale, int64_t steps) {
    const int32_t limit = scale->limit_steps;
    const int64_t kept = steps > limit ? limit : steps < -limit ? -limit : steps;
    return (float)(int32_t)kept * scale->step_rad;
}

/** step * part / whole, with whole > 0. */
static inline angle_t angle_part(angle_step_t step_rad, uint16_t part, uint16_t whole) {
    return step_rad * (float)part / (float)whole;
}

/** Any angle in urad. */
static inline angle_t angle_from_urad(uint32_t angle_urad) {
    return (float)angle_urad * 1e-6f;
}

/** a + b */
static inline angle_t angle_sum(angle_t a, angle_t b) {
    return a + b;
}

/** a - b */
static inline angle_t angle_difference(angle_t a, angle_t b) {
    return a - b;
}

/** a - b, both 0 or more. */
static inline angle_t angle_distance(angle_t a, angle_t b) {
    return a - b;
}

/** 2 a - b, a 0 to 2 rad, b 0 or more. */
static inline angle_t angle_past_half(angle_t a, angle_t b) {
    return a + a - b;
}

/** |angle| */
static inline angle_t angle_abs(angle_t angle) {
    return angle < 0.0f ? -angle : angle;
}

/** torque_mNm / parts, as a torque. |torque_mNm| below 2^24 is exact before the division. */
static inline torque_t torque_from_mNm(int32_t torque_mNm, uint32_t parts) {
    const uint32_t parts_per_Nm = 1000U * parts;
    return (float)torque_mNm / (float)parts_per_Nm;
}

/** torque * numerator / denominator; exactly torque where both are equal. torque >= 0,
 * denominator > 0, |numerator| up to denominator */
static inline torque_t torque_fraction(torque_t torque, angle_t numerator, angle_t denominator) {
    return torque * (numerator / denominator);
}

/** low + (high - low) * numerator / denominator. 0 <= low <= high, 0 <= numerator <= denominator,
 * denominator > 0 */
static inline torque_t torque_between(torque_t low, torque_t high, angle_t numerator,
                                      angle_t denominator) {
    return low + (high - low) * (numerator / denominator);
}

/** slope * elapsed. elapsed_us 0..1000000 */
static inline torque_t torque_from_slope(uint32_t slope_mNm_s, uint32_t elapsed_us) {
    return (float)slope_mNm_s * (float)elapsed_us * 1e-9f;
}

/** torque * part / whole; exactly torque where both are equal. torque >= 0, whole > 0, part up to
 * whole */
static inline torque_t torque_part(torque_t torque, uint32_t part, uint32_t whole) {
    return torque * ((float)part / (float)whole);
}

/** a + b */
static inline torque_t torque_sum(torque_t a, torque_t b) {
    return a + b;
}

/** a - b */
static inline torque_t torque_difference(torque_t a, torque_t b) {
    return a - b;
}

/** -torque */
static inline torque_t torque_negated(torque_t torque) {
    return -torque;
}

/** |torque| */
static inline torque_t torque_abs(torque_t torque) {
    return torque < 0.0f ? -torque : torque;
}

/** The lesser one. */
static inline torque_t torque_min(torque_t a, torque_t b) {
    return a < b ? a : b;
}

/** The greater one. */
static inline torque_t torque_max(torque_t a, torque_t b) {
    return a > b ? a : b;
}

/** False when one of the two is NaN: the only case in which neither is less or equal. */
static inline bool torques_are_numbers(torque_t a, torque_t b) {
    /* cppcheck-suppress knownConditionTrueFalse ; it does not know NaN */
    return a <= b || b <= a;
}

/** False for NaN. */
static inline bool torque_is_number(torque_t torque) {
    return torque == torque;
}

/** Whole mN m of a torque that is not negative: rounded half up, saturated to 32767. */
static inline int16_t torque_size_to_mNm(torque_t size) {
    const float scaled = size * 1000.0f;
    if (scaled >= 32767.0f) {
        return INT16_MAX;
    }
    const int32_t halves = (int32_t)(scaled * 2.0f); /* exact: adding 0.5 would round twice */
    return (int16_t)((halves + 1) / 2);
}

#endif
