/* What only floats can be: not a number, and infinite. */
#include "unity.h"

#include "control/number.h"
#include "control/torque_guard.h"
#include "numbers.h"

static torque_guard_input_t input;
static float nan_Nm;
static float infinity_Nm;

void setUp(void) {
    const float zero = 0.0f;
    const torque_guard_input_t free_motion = {
        .torque_Nm = 3.0f,
        .slope_mNm_s = TORQUE_GUARD_SLOPE_OFF,
        .torque_limit_Nm = 20.0f,
        .ramp_ppm = TORQUE_GUARD_RAMP_FULL,
        .torque_max_Nm = 8.0f,
        .f_max_Nm = 2.0f,
        .position_min_inc = -1000,
        .position_max_inc = 1000,
        .motor = {.temperature_end_dC = 1},
    };
    nan_Nm = zero / zero;
    infinity_Nm = 1.0f / zero;
    input = free_motion;
}
void tearDown(void) {}

static void expect(int16_t torque_mNm, uint16_t reasons) {
    const torque_guard_output_t output = torque_guard(&input);
    TEST_ASSERT_EQUAL_INT16(torque_mNm, output.torque_mNm);
    TEST_ASSERT_EQUAL_HEX16(reasons, output.reasons);
}

void test_not_a_number_beside_a_number_is_found(void) {
    TEST_ASSERT_TRUE(torques_are_numbers(1.0f, -infinity_Nm));
    TEST_ASSERT_FALSE(torques_are_numbers(nan_Nm, 1.0f));
    TEST_ASSERT_FALSE(torques_are_numbers(1.0f, nan_Nm));
    TEST_ASSERT_FALSE(torques_are_numbers(nan_Nm, nan_Nm));
}

void test_the_guard_takes_not_a_number_as_zero(void) {
    float *const values[] = {&input.torque_Nm, &input.torque_limit_Nm, &input.torque_max_Nm,
                             &input.f_max_Nm, &input.torque_before_Nm};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        setUp();
        *values[i] = nan_Nm;
        expect(0, LIMIT_REASON_NOT_A_NUMBER);
    }
}

void test_the_guard_cuts_infinity(void) {
    input.torque_Nm = infinity_Nm;
    expect(8000, LIMIT_REASON_TORQUE_MAX);
}

void test_rounding_happens_once(void) {
    /* The float below half a mN m: adding 0.5 to its 1000-fold would give 1. */
    TEST_ASSERT_EQUAL_INT16(0, in_mNm(0.00049999997f));
    TEST_ASSERT_EQUAL_INT16(1, in_mNm(0.0005f));
    TEST_ASSERT_EQUAL_INT16(3, in_mNm(0.0025f));
}
