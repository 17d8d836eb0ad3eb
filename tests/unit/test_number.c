/* Numbers of the control law: exact differences, saturation, rounding on the way out. */
#include "unity.h"

#include "control/number.h"

void setUp(void) {}
void tearDown(void) {}

void test_angle_of_one_revolution_fraction(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    TEST_ASSERT_FLOAT_WITHIN(1e-9f, 9.58738e-5f, angle_from_steps(&scale, 1));
    TEST_ASSERT_FLOAT_WITHIN(1e-8f, -0.0958738f, angle_from_steps(&scale, -1000));
}

void test_parts_of_an_increment(void) {
    const angle_scale_t whole = angle_scale(65536, 1);
    const angle_scale_t fifth = angle_scale(65536, 5);
    TEST_ASSERT_FLOAT_WITHIN(1e-9f, angle_from_steps(&whole, 100), angle_from_steps(&fifth, 500));
}

void test_angle_saturates_at_half_a_radian(void) {
    const angle_scale_t scale = angle_scale(65536, 1);
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, 0.5f, angle_from_steps(&scale, 5216));
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, 0.5f, angle_from_steps(&scale, (int64_t)1 << 40));
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, -0.5f, angle_from_steps(&scale, -((int64_t)1 << 40)));
}

void test_torque_rounds_half_away_from_zero(void) {
    TEST_ASSERT_EQUAL_INT16(1, torque_to_mNm(0.0005f));
    TEST_ASSERT_EQUAL_INT16(-1, torque_to_mNm(-0.0005f));
    TEST_ASSERT_EQUAL_INT16(0, torque_to_mNm(0.000499f));
    TEST_ASSERT_EQUAL_INT16(0, torque_to_mNm(-0.000499f));
    TEST_ASSERT_EQUAL_INT16(3, torque_to_mNm(0.0025f));
    TEST_ASSERT_EQUAL_INT16(1234, torque_to_mNm(1.234f));
}

void test_torque_saturates_symmetrically(void) {
    TEST_ASSERT_EQUAL_INT16(32767, torque_to_mNm(32.767f));
    TEST_ASSERT_EQUAL_INT16(32767, torque_to_mNm(1e30f));
    TEST_ASSERT_EQUAL_INT16(-32767, torque_to_mNm(-32.768f));
    TEST_ASSERT_EQUAL_INT16(-32767, torque_to_mNm(-1e30f));
}

void test_not_a_number_leaves_as_zero(void) {
    const float zero = 0.0f;
    TEST_ASSERT_EQUAL_INT16(0, torque_to_mNm(zero / zero));
}

void test_every_bus_torque_comes_back_unchanged(void) {
    for (int32_t torque = -32767; torque <= 32767; torque++) {
        TEST_ASSERT_EQUAL_INT16(torque, torque_to_mNm(torque_from_mNm(torque, 1)));
    }
}

void test_scaling_by_one_is_exact(void) {
    const torque_t torque = 1.2345f;
    TEST_ASSERT_TRUE(torque_scaled(torque, 0.0123f, 0.0123f) == torque);
    TEST_ASSERT_TRUE(torque_part(torque, 1000000, 1000000) == torque);
}
