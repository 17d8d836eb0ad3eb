/* Numbers of the control law, what holds in both builds: exact differences, saturation, rounding on
 * the way out. */
#include "unity.h"

#include "control/number.h"
#include "numbers.h"

void setUp(void) {}
void tearDown(void) {}

void test_angle_of_one_revolution_fraction(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    TEST_ASSERT_FLOAT_WITHIN(ANGLE_STEP_rad, 9.58738e-5f, in_rad(angle_from_steps(&scale, 1)));
    TEST_ASSERT_FLOAT_WITHIN(1e-8f, -0.0958738f, in_rad(angle_from_steps(&scale, -1000)));
}

void test_parts_of_an_increment(void) {
    const angle_scale_t whole = angle_scale(65536, 1);
    const angle_scale_t fifth = angle_scale(65536, 5);
    TEST_ASSERT_FLOAT_WITHIN(ANGLE_STEP_rad, in_rad(angle_from_steps(&whole, 100)),
                             in_rad(angle_from_steps(&fifth, 500)));
}

void test_angle_saturates_at_half_a_radian(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    const float limit_rad = 5215.0f * 9.58738e-5f; /* 5215.19 increments are 0.5 rad */
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, limit_rad, in_rad(angle_from_steps(&scale, 5216)));
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, limit_rad, in_rad(angle_from_steps(&scale, INT64_MAX)));
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, -limit_rad, in_rad(angle_from_steps(&scale, INT64_MIN)));
}

void test_limit_is_half_a_radian_in_whole_steps(void) {
    TEST_ASSERT_EQUAL_INT32(20, angle_limit_steps(256, 1));
    TEST_ASSERT_EQUAL_INT32(81, angle_limit_steps(1024, 1));
    TEST_ASSERT_EQUAL_INT32(5215, angle_limit_steps(65536, 1));
    TEST_ASSERT_EQUAL_INT32(26075, angle_limit_steps(65536, 5));
    TEST_ASSERT_EQUAL_INT32(13350884, angle_limit_steps(1U << 24, 10));
}

void test_part_of_a_step(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    TEST_ASSERT_FLOAT_WITHIN(ANGLE_STEP_rad, 0.5f * 9.58738e-5f,
                             in_rad(angle_part(scale.step_rad, 128, 256)));
    TEST_ASSERT_FLOAT_WITHIN(1e-8f, 0.02454331f,
                             in_rad(angle_part(scale.step_rad, UINT16_MAX, 256)));
    TEST_ASSERT_EQUAL_FLOAT(0.0f, in_rad(angle_part(scale.step_rad, 0, 256)));
}

void test_angle_from_microradians(void) {
    TEST_ASSERT_FLOAT_WITHIN(ANGLE_STEP_rad, 0.0075f, in_rad(angle_from_urad(7500)));
    TEST_ASSERT_FLOAT_WITHIN(1e-7f, 0.5f, in_rad(angle_from_urad(500000)));
}

void test_torque_of_parts(void) {
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 1.2346f, in_Nm(torque_from_mNm(12346, 10)));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, -0.0333333f, in_Nm(torque_from_mNm(-100, 3)));
}

void test_torque_rounds_half_away_from_zero(void) {
    TEST_ASSERT_EQUAL_INT16(1, in_mNm(torque_of(0.00052f)));
    TEST_ASSERT_EQUAL_INT16(-1, in_mNm(torque_of(-0.00052f)));
    TEST_ASSERT_EQUAL_INT16(0, in_mNm(torque_of(0.00048f)));
    TEST_ASSERT_EQUAL_INT16(0, in_mNm(torque_of(-0.00048f)));
    TEST_ASSERT_EQUAL_INT16(1234, in_mNm(torque_of(1.234f)));
    /* Exact in both builds: 1/16 and 3/16 N m = 62.5 and 187.5 mN m. */
    TEST_ASSERT_EQUAL_INT16(63, in_mNm(torque_of(0.0625f)));
    TEST_ASSERT_EQUAL_INT16(-188, in_mNm(torque_of(-0.1875f)));
}

void test_torque_saturates_symmetrically(void) {
    TEST_ASSERT_EQUAL_INT16(32767, in_mNm(torque_of(32.767f)));
    TEST_ASSERT_EQUAL_INT16(32767, in_mNm(torque_of(32767.0f)));
    TEST_ASSERT_EQUAL_INT16(-32767, in_mNm(torque_of(-32.768f)));
    TEST_ASSERT_EQUAL_INT16(-32767, in_mNm(torque_of(-32767.0f)));
}

void test_every_bus_torque_comes_back_unchanged(void) {
    for (int32_t torque = -32767; torque <= 32767; torque++) {
        TEST_ASSERT_EQUAL_INT16(torque, in_mNm(torque_from_mNm(torque, 1)));
    }
}

void test_scaling_by_one_is_exact(void) {
    const torque_t torque = torque_of(1.2345f);
    const angle_t angle = angle_of(0.0123f);
    TEST_ASSERT_TRUE(torque_fraction(torque, angle, angle) == torque);
    TEST_ASSERT_TRUE(torque_part(torque, 1000000, 1000000) == torque);
}

void test_fractions_have_the_sign_of_the_numerator(void) {
    const torque_t bound = torque_of(2.0f);
    TEST_ASSERT_TRUE(torque_fraction(bound, angle_of(-0.25f), angle_of(0.5f)) == torque_of(-1.0f));
    TEST_ASSERT_TRUE(torque_between(bound, torque_of(3.0f), angle_of(0.25f), angle_of(0.5f)) ==
                     torque_of(2.5f));
    TEST_ASSERT_TRUE(torque_is_number(bound));
}
