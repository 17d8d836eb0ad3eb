/**
 * The numbers of the control law: angles in rad, torques in N m, and the few operations on them
 * that the law needs.
 *
 * This is the float build: IEEE single, no double, no fused operations. A position never becomes a
 * number; only the difference of two positions does, after it was formed exactly in integers and
 * saturated to +-0.5 rad. Torques leave as whole mN m, rounded half away from zero, saturated to
 * +-32767; NaN leaves as 0.
 */
#ifndef NUMBER_H
#define NUMBER_H

#include <stdbool.h>
#include <stdint.h>

typedef float number_t;
typedef number_t angle_t;  /**< rad */
typedef number_t torque_t; /**< N m */

/** How a difference of positions becomes an angle. One step = 1 increment / parts. */
typedef struct {
    int32_t limit_steps; /**< 0.5 rad */
    number_t step_rad;
} angle_scale_t;

static inline angle_scale_t angle_scale(uint32_t increments_per_revolution, uint32_t parts) {
    const number_t step_rad = 6.2831853f / (number_t)(increments_per_revolution * parts);
    const angle_scale_t scale = {.limit_steps = (int32_t)(0.5f / step_rad), .step_rad = step_rad};
    return scale;
}

static inline angle_t angle_from_steps(const angle_scale_t *scale, int64_t steps) {
    if (steps > scale->limit_steps) {
        steps = scale->limit_steps;
    } else if (steps < -(int64_t)scale->limit_steps) {
        steps = -(int64_t)scale->limit_steps;
    }
    return (number_t)(int32_t)steps * scale->step_rad;
}

static inline angle_t angle_from_urad(uint32_t angle_urad) {
    return (number_t)angle_urad * 1e-6f;
}

/** angle * part / whole */
static inline angle_t angle_part(angle_t angle, uint32_t part, uint32_t whole) {
    return angle * (number_t)part / (number_t)whole;
}

static inline angle_t angle_abs(angle_t angle) {
    return angle < 0.0f ? -angle : angle;
}

/** torque_mNm / parts, as a torque. |torque_mNm| below 2^24 is exact before the division. */
static inline torque_t torque_from_mNm(int32_t torque_mNm, uint32_t parts) {
    return (number_t)torque_mNm / (number_t)(1000U * parts);
}

/** torque * numerator / denominator; exactly torque where both are equal. denominator > 0 */
static inline torque_t torque_scaled(torque_t torque, angle_t numerator, angle_t denominator) {
    return torque * (numerator / denominator);
}

/** torque * part / whole, with whole > 0; exactly torque where both are equal. */
static inline torque_t torque_part(torque_t torque, uint32_t part, uint32_t whole) {
    return torque * ((number_t)part / (number_t)whole);
}

static inline torque_t torque_abs(torque_t torque) {
    return torque < 0.0f ? -torque : torque;
}

static inline torque_t torque_min(torque_t a, torque_t b) {
    return a < b ? a : b;
}

static inline torque_t torque_max(torque_t a, torque_t b) {
    return a > b ? a : b;
}

static inline torque_t torque_clamp(torque_t torque, torque_t bound) {
    return torque > bound ? bound : torque < -bound ? -bound : torque;
}

static inline bool torque_is_number(torque_t torque) {
    return torque == torque;
}

static inline int16_t torque_to_mNm(torque_t torque) {
    const number_t scaled = torque * 1000.0f;
    if (!torque_is_number(scaled)) {
        return 0;
    }
    if (scaled >= 32767.0f) {
        return INT16_MAX;
    }
    if (scaled <= -32767.0f) {
        return -INT16_MAX;
    }
    const int32_t whole = (int32_t)scaled;
    const number_t rest = scaled - (number_t)whole; /* exact: adding 0.5 first would round twice */
    const int32_t carry = rest >= 0.5f ? 1 : rest <= -0.5f ? -1 : 0;
    return (int16_t)(whole + carry);
}

#endif
