/* The formats of the fixed build: units, rounding to the last bit, and saturation at the ends of
 * the 32-bit range. Run under the sanitizers, which see a wrapped result. */
#include "unity.h"

#include "control/number.h"
#include "control/torque_guard.h"
#include "numbers.h"

#define HALF_RADIAN (1 << 28)

static const int32_t ends[] = {INT32_MIN, -INT32_MAX, -1, 0, 1, INT32_MAX};
#define ENDS (sizeof ends / sizeof ends[0])

void setUp(void) {}
void tearDown(void) {}

void test_angles_are_in_2_to_the_minus_29_rad(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    TEST_ASSERT_EQUAL_INT32(51472, angle_from_steps(&scale, 1)); /* 51471.85 */
    TEST_ASSERT_EQUAL_INT32(51471854, angle_from_steps(&scale, 1000));
    TEST_ASSERT_EQUAL_INT32(-51471854, angle_from_steps(&scale, -1000));
    TEST_ASSERT_EQUAL_INT32(4026532, angle_from_urad(7500)); /* 4026531.84 */
    TEST_ASSERT_EQUAL_INT32(HALF_RADIAN, angle_from_urad(500000));
}

void test_the_finest_and_the_coarsest_scale(void) {
    const angle_scale_t finest = angle_scale(1U << 24, 10);
    const angle_scale_t coarsest = angle_scale(256, 1);
    TEST_ASSERT_EQUAL_INT32(20, angle_from_steps(&finest, 1)); /* 20.106 */
    TEST_ASSERT_EQUAL_INT32(20106193, angle_from_steps(&finest, 1000000));
    TEST_ASSERT_EQUAL_INT32(HALF_RADIAN - 6, angle_from_steps(&finest, INT64_MAX));
    TEST_ASSERT_EQUAL_INT32(13176795, angle_from_steps(&coarsest, 1)); /* 13176794.6 */
    TEST_ASSERT_EQUAL_INT32(-263535893, angle_from_steps(&coarsest, INT64_MIN));
}

void test_part_of_a_step_saturates(void) {
    const angle_scale_t coarsest = angle_scale(256, 1);
    TEST_ASSERT_EQUAL_INT32(6588397, angle_part(coarsest.step_rad, 128, 256)); /* 6588397.3 */
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, angle_part(coarsest.step_rad, UINT16_MAX, 256));
}

void test_torques_are_in_2_to_the_minus_16_Nm(void) {
    TEST_ASSERT_EQUAL_INT32(65536, torque_from_mNm(1000, 1));
    TEST_ASSERT_EQUAL_INT32(66, torque_from_mNm(1, 1)); /* 65.54 */
    TEST_ASSERT_EQUAL_INT32(-66, torque_from_mNm(-1, 1));
    TEST_ASSERT_EQUAL_INT32(7, torque_from_mNm(1, 10));            /* 6.55 */
    TEST_ASSERT_EQUAL_INT32(2147418, torque_from_mNm(327670, 10)); /* 2147418.1 */
}

void test_ratios_round_half_away_from_zero(void) {
    TEST_ASSERT_EQUAL_INT32(2, torque_fraction(3, 1, 2));
    TEST_ASSERT_EQUAL_INT32(-2, torque_fraction(3, -1, 2));
    TEST_ASSERT_EQUAL_INT32(1, torque_fraction(4, 1, 3));
    TEST_ASSERT_EQUAL_INT32(1, torque_part(1, 1, 2));
    TEST_ASSERT_EQUAL_INT32(0, torque_part(1, 1, 3));
}

static void check_fraction(uint32_t factor, uint32_t numerator, uint32_t denominator) {
    const uint64_t exactly =
        ((uint64_t)factor * numerator + denominator / 2U) / denominator; /* 64 bits */
    TEST_ASSERT_EQUAL_INT32(exactly, number_fraction(factor, numerator, denominator));
}

/* Edges, and random numbers of random lengths: each digit of the quotient guessed right, one too
 * high and two too high. */
void test_fractions_are_exact(void) {
    static const uint32_t denominators[] = {1,          2,          3,          0xFFFF,
                                            0x10000,    0x10001,    0x7FFFFFFF, 0x80000000,
                                            0x8000FFFF, 0xFFFF0001, UINT32_MAX};
    uint64_t random = 1;
    for (size_t i = 0; i < sizeof denominators / sizeof denominators[0]; i++) {
        const uint32_t whole = denominators[i];
        const uint32_t parts[] = {0, 1, whole / 2U, whole / 2U + 1U, whole - 1U, whole};
        for (size_t j = 0; j < sizeof parts / sizeof parts[0]; j++) {
            check_fraction(0, parts[j] < whole ? parts[j] : whole, whole);
            check_fraction(1, parts[j] < whole ? parts[j] : whole, whole);
            check_fraction(0xFFFF, parts[j] < whole ? parts[j] : whole, whole);
            check_fraction(INT32_MAX, parts[j] < whole ? parts[j] : whole, whole);
        }
    }
    for (int i = 0; i < 1000000; i++) {
        random ^= random << 13; /* xorshift: Marsaglia 2003 */
        random ^= random >> 7;
        random ^= random << 17;
        const uint32_t denominator = (uint32_t)(random >> 32 >> (random & 31U)) | 1U;
        const uint32_t numerator = (uint32_t)random % denominator;
        check_fraction((uint32_t)(random >> 24) & (uint32_t)INT32_MAX, numerator, denominator);
    }
}

void test_a_fraction_above_one_is_one(void) {
    TEST_ASSERT_EQUAL_INT32(7, torque_fraction(7, 3, 2));
    TEST_ASSERT_EQUAL_INT32(-7, torque_fraction(7, INT32_MIN, 2));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, torque_part(INT32_MAX, UINT32_MAX, 1));
}

void test_conversion_from_mNm_is_exact(void) {
    for (uint32_t parts = 1; parts <= 10U; parts++) {
        for (int64_t torque_mNm = -327670; torque_mNm <= 327670; torque_mNm++) {
            const int64_t size = torque_mNm < 0 ? -torque_mNm : torque_mNm;
            const int64_t exactly = ((size << 16) + 500 * (int64_t)parts) / (1000 * (int64_t)parts);
            const int32_t torque = torque_from_mNm((int32_t)torque_mNm, parts);
            if (torque != (torque_mNm < 0 ? -exactly : exactly)) {
                TEST_FAIL_MESSAGE("torque_from_mNm");
            }
        }
    }
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, torque_from_mNm(INT32_MAX, 65));
    TEST_ASSERT_EQUAL_INT32(2147418112, torque_from_mNm(32767000, 1));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, torque_from_mNm(32768000, 1));
}

void test_torque_leaves_rounded_to_the_last_bit(void) {
    TEST_ASSERT_EQUAL_INT16(0, in_mNm(32)); /* .488 mN m */
    TEST_ASSERT_EQUAL_INT16(1, in_mNm(33)); /* .504 mN m */
    TEST_ASSERT_EQUAL_INT16(-1, in_mNm(-33));
}

void test_nothing_wraps_at_the_ends_of_the_range(void) {
    for (size_t i = 0; i < ENDS; i++) {
        const int64_t a = ends[i];
        const int32_t size = a == INT32_MIN ? INT32_MAX : (int32_t)(a < 0 ? -a : a);
        TEST_ASSERT_EQUAL_INT32(size, angle_abs(ends[i]));
        TEST_ASSERT_EQUAL_INT32(size, torque_abs(ends[i]));
        TEST_ASSERT_EQUAL_INT32(a > 0 ? -size : size, torque_negated(ends[i]));
        TEST_ASSERT_EQUAL_INT16(a > 1 ? 32767 : a < -1 ? -32767 : 0, in_mNm(ends[i]));
        for (size_t j = 0; j < ENDS; j++) {
            const int64_t sum = a + ends[j];
            const int64_t difference = a - ends[j];
            const int32_t kept_sum = number_saturated(sum);
            TEST_ASSERT_EQUAL_INT32(kept_sum, angle_sum(ends[i], ends[j]));
            TEST_ASSERT_EQUAL_INT32(kept_sum, torque_sum(ends[i], ends[j]));
            TEST_ASSERT_EQUAL_INT32(number_saturated(difference),
                                    angle_difference(ends[i], ends[j]));
            TEST_ASSERT_EQUAL_INT32(number_saturated(difference),
                                    torque_difference(ends[i], ends[j]));
        }
    }
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, number_saturated((int64_t)INT32_MAX + 1));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, number_saturated(INT32_MIN));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, angle_from_urad(UINT32_MAX));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, torque_from_mNm(INT32_MAX, 1));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, torque_from_mNm(INT32_MIN, 1));
}

void test_the_guard_takes_any_torque(void) {
    for (size_t i = 0; i < ENDS; i++) {
        const torque_guard_input_t input = {
            .torque_Nm = ends[i],
            .torque_limit_Nm = INT32_MAX,
            .ramp_ppm = TORQUE_GUARD_RAMP_FULL,
            .torque_max_Nm = INT32_MAX,
            .f_max_Nm = INT32_MIN,
            .position_min_inc = INT32_MIN,
            .position_max_inc = INT32_MAX,
            .slope_mNm_s = TORQUE_GUARD_SLOPE_OFF,
            .motor = {.temperature_end_dC = 1},
        };
        const int16_t expected = in_mNm(ends[i]);
        TEST_ASSERT_EQUAL_INT16(expected, torque_guard(&input).torque_mNm);
    }
}
