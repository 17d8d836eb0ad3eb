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

/** Of value > 0. */
static inline uint32_t number_leading_zeros(uint32_t value) {
    return (uint32_t)__builtin_clz(value); /* GCC's and clang's */
}

/** |value|, INT32_MIN included */
static inline uint32_t number_size32(int32_t value) {
    return value < 0 ? (uint32_t)(-(int64_t)value) : (uint32_t)value;
}

/** At most INT32_MAX */
static inline int32_t number_kept(uint32_t size) {
    return size < (uint32_t)INT32_MAX ? (int32_t)size : INT32_MAX;
}

/** |value|, of INT32_MIN INT32_MAX */
static inline int32_t number_abs(int32_t value) {
    return number_kept(number_size32(value));
}

/** At most INT32_MAX in size. */
static inline int32_t number_saturated(int64_t value) {
    return (int32_t)(value > INT32_MAX ? INT32_MAX : value < -INT32_MAX ? -INT32_MAX : value);
}

/** dividend / divisor, rounded half up. dividend <= 2^63, 0 < divisor < 2^63 */
static inline int32_t number_ratio(uint64_t dividend, uint64_t divisor) {
    const uint64_t ratio = (dividend + divisor / 2U) / divisor;
    return ratio < (uint64_t)INT32_MAX ? (int32_t)ratio : INT32_MAX;
}

/** factor * numerator / denominator, rounded half up; a fraction above 1 is 1. Exact, by two
 * divisions of 32 bits (the schoolbook's, digits of 16 bits, divisor normalised), which processors
 * have where a division of 64 bits is a function of many steps.
 * factor 0..INT32_MAX, denominator > 0 */
static inline int32_t number_fraction(uint32_t factor, uint32_t numerator, uint32_t denominator) {
    const uint32_t zeros = number_leading_zeros(denominator);
    const uint32_t divisor = denominator << zeros;
    const uint32_t divisor_high = divisor >> 16;
    const uint32_t part_of_it = (numerator < denominator ? numerator : denominator) << zeros;
    const uint32_t half = (denominator >> 1) << zeros;
    const uint64_t dividend = (uint64_t)factor * part_of_it + half; /* below 2^63 */

    uint32_t high = (uint32_t)(dividend >> 32) / divisor_high; /* too large by 2 at most */
    uint64_t part = (uint64_t)high * divisor;
    const uint64_t upper = dividend >> 16;
    while (part > upper) {
        high--;
        part -= divisor;
    }
    const uint32_t rest = (uint32_t)(upper - part); /* below divisor */
    uint32_t low = rest / divisor_high;
    part = (uint64_t)low * divisor;
    const uint64_t lower = ((uint64_t)rest << 16) | (dividend & 0xFFFFU);
    while (part > lower) {
        low--;
        part -= divisor;
    }
    const uint32_t quotient = (high << 16) + low; /* at most factor */
    return (int32_t)quotient;
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
    const int32_t kept = (int32_t)(steps > limit ? limit : steps < -limit ? -limit : steps);
    const uint64_t size_2p61 = number_size32(kept) * scale->step_rad; /* <= 0.5 rad: no overflow */
    const int32_t size_2p29 = (int32_t)((size_2p61 + ((uint64_t)1 << 31)) >> 32);
    return kept < 0 ? -size_2p29 : size_2p29;
}

/** step * part / whole, with whole > 0. */
static inline angle_t angle_part(angle_step_t step_rad, uint16_t part, uint16_t whole) {
    const uint64_t step_2p45 = step_rad >> 16; /* room for the product */
    return number_ratio(step_2p45 * part, (uint64_t)whole << 16);
}

/** 0..3999999 urad exactly rounded, more saturates. */
static inline angle_t angle_from_urad(uint32_t angle_urad) {
    return number_ratio((uint64_t)angle_urad << 29, 1000000U);
}

/** a + b */
static inline angle_t angle_sum(angle_t a, angle_t b) {
    return number_saturated((int64_t)a + b);
}

/** a - b */
static inline angle_t angle_difference(angle_t a, angle_t b) {
    return number_saturated((int64_t)a - b);
}

/** a - b, both 0 or more. */
static inline angle_t angle_distance(angle_t a, angle_t b) {
    return a - b;
}

/** 2 a - b, a 0 to 2 rad, b 0 or more. */
static inline angle_t angle_past_half(angle_t a, angle_t b) {
    return a - b + a;
}

/** |angle| */
static inline angle_t angle_abs(angle_t angle) {
    return number_abs(angle);
}

/** torque_mNm / parts, as a torque. parts 1..65 */
static inline torque_t torque_from_mNm(int32_t torque_mNm, uint32_t parts) {
    const uint32_t parts_per_Nm =
        1000U * parts; /* below 2^16: so are rests, and their shifts fit */
    const uint32_t size = number_size32(torque_mNm);
    const uint32_t whole_Nm = size / parts_per_Nm;
    const uint32_t rest = size - whole_Nm * parts_per_Nm;
    const uint32_t fraction = ((rest << 16) + parts_per_Nm / 2U) / parts_per_Nm; /* up to 2^16 */
    if (whole_Nm >= 32768U) {
        return torque_mNm < 0 ? -INT32_MAX : INT32_MAX;
    }
    const int32_t torque = number_kept((whole_Nm << 16) + fraction);
    return torque_mNm < 0 ? -torque : torque;
}

/** torque * numerator / denominator; exactly torque where both are equal. torque >= 0,
 * denominator > 0; the fraction is kept within +-1 */
static inline torque_t torque_fraction(torque_t torque, angle_t numerator, angle_t denominator) {
    const int32_t size =
        number_fraction((uint32_t)torque, number_size32(numerator), (uint32_t)denominator);
    return numerator < 0 ? -size : size;
}

/** low + (high - low) * numerator / denominator. 0 <= low <= high, 0 <= numerator <= denominator,
 * denominator > 0 */
static inline torque_t torque_between(torque_t low, torque_t high, angle_t numerator,
                                      angle_t denominator) {
    const int32_t rise = high - low;
    return low + number_fraction((uint32_t)rise, (uint32_t)numerator, (uint32_t)denominator);
}

/** slope * elapsed. elapsed_us 0..1000000 */
static inline torque_t torque_from_slope(uint32_t slope_mNm_s, uint32_t elapsed_us) {
    const uint64_t torque_nNm = (uint64_t)slope_mNm_s * elapsed_us; /* below 2^52 */
    return number_ratio(torque_nNm << 7, 1953125U);                 /* 2^16 / 10^9 */
}

/** torque * part / whole; exactly torque where both are equal. torque >= 0, whole > 0, part up to
 * whole */
static inline torque_t torque_part(torque_t torque, uint32_t part, uint32_t whole) {
    return number_fraction((uint32_t)torque, part, whole);
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
    return number_abs(torque);
}

/** The lesser one. */
static inline torque_t torque_min(torque_t a, torque_t b) {
    return a < b ? a : b;
}

/** The greater one. */
static inline torque_t torque_max(torque_t a, torque_t b) {
    return a > b ? a : b;
}

/** Here always: there is no other value. */
static inline bool torques_are_numbers(torque_t a, torque_t b) {
    (void)a;
    (void)b;
    return true;
}

/** Here always: there is no other value. */
static inline bool torque_is_number(torque_t torque) {
    (void)torque;
    return true;
}

/** Whole mN m of a torque that is not negative: rounded half up, saturated to 32767. */
static inline int16_t torque_size_to_mNm(torque_t size) {
    const uint32_t size_mNm = (uint32_t)(((uint64_t)(uint32_t)size * 1000U + (1U << 15)) >> 16);
    return (int16_t)(size_mNm < (uint32_t)INT16_MAX ? size_mNm : (uint32_t)INT16_MAX);
}

#endif
