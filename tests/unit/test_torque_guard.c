/* Torque guard: each bound alone, with its reason, and all of them on random input. */
#include "unity.h"

#include "control/torque_guard.h"
#include "numbers.h"

static torque_guard_input_t input;

void setUp(void) {
    const torque_guard_input_t free_motion = {
        .torque_Nm = torque_of(3.0f),
        .torque_limit_Nm = torque_of(20.0f),
        .ramp_ppm = TORQUE_GUARD_RAMP_FULL,
        .torque_max_Nm = torque_of(8.0f),
        .f_max_Nm = torque_of(2.0f),
        .position_min_inc = -1000,
        .position_max_inc = 1000,
    };
    input = free_motion;
}
void tearDown(void) {}

static float absolute(float value) {
    return value < 0.0f ? -value : value;
}

static void expect(int16_t torque_mNm, uint16_t reasons) {
    const torque_guard_output_t output = torque_guard(&input);
    TEST_ASSERT_EQUAL_INT16(torque_mNm, output.torque_mNm);
    TEST_ASSERT_EQUAL_HEX16(reasons, output.reasons);
}

void test_passes_what_is_allowed(void) {
    expect(3000, 0);
}

void test_ramp_bounds_the_output(void) {
    input.ramp_ppm = 100000;
    expect(2000, LIMIT_REASON_BOUND_RAMP);
    input.torque_Nm = torque_of(-3.0f);
    expect(-2000, LIMIT_REASON_BOUND_RAMP);
    input.ramp_ppm = 0;
    expect(0, LIMIT_REASON_BOUND_RAMP);
}

void test_ramp_does_not_touch_a_small_torque(void) {
    input.ramp_ppm = 160000;
    expect(3000, 0);
}

void test_torque_limit(void) {
    input.torque_limit_Nm = torque_of(2.5f);
    expect(2500, LIMIT_REASON_TORQUE_LIMIT);
}

void test_torque_max_or_latched_whichever_is_larger(void) {
    input.torque_Nm = torque_of(9.0f);
    expect(8000, LIMIT_REASON_TORQUE_MAX);
    input.f_max_Nm = torque_of(8.5f);
    expect(8500, LIMIT_REASON_TORQUE_MAX);
    input.f_max_Nm = torque_of(9.5f);
    expect(9000, 0);
}

void test_no_torque_outward_at_a_position_limit(void) {
    input.position_inc = 1000;
    expect(0, LIMIT_REASON_POSITION_LIMIT);
    input.position_inc = 999;
    expect(3000, 0);
    input.torque_Nm = torque_of(-3.0f);
    input.position_inc = -1000;
    expect(0, LIMIT_REASON_POSITION_LIMIT);
    input.position_inc = -999;
    expect(-3000, 0);
}

void test_torque_inward_beyond_a_position_limit(void) {
    input.position_inc = -5000;
    expect(3000, 0);
    input.torque_Nm = torque_of(-3.0f);
    input.position_inc = 5000;
    expect(-3000, 0);
}

void test_bounds_hold_for_random_input(void) {
    uint32_t state = 1;
    for (int i = 0; i < 200000; i++) {
        uint32_t value[6];
        for (int j = 0; j < 6; j++) {
            state = state * 1664525U + 1013904223U;
            value[j] = state >> 8;
        }
        input.torque_Nm = torque_of(((float)value[0] - 8388608.0f) * 1e-5f);
        input.torque_limit_Nm = torque_of((float)value[1] * 1.9e-6f);
        input.torque_max_Nm = torque_of((float)value[2] * 1.9e-6f);
        input.f_max_Nm = torque_of((float)value[3] * 1.9e-6f);
        input.ramp_ppm = value[4] % 1000001U;
        input.position_inc = (int32_t)(value[5] % 2400U) - 1200;
        const torque_guard_output_t output = torque_guard(&input);
        const float asked = in_Nm(input.torque_Nm);
        const float torque = (float)output.torque_mNm * 0.001f;
        const float half = 0.00051f + TORQUE_STEP_Nm; /* rounding to whole mN m */
        const float size = absolute(torque);
        const float ramp_bound = in_Nm(input.torque_limit_Nm) * (float)input.ramp_ppm * 1e-6f;
        TEST_ASSERT_TRUE(size <= absolute(asked) + half);
        TEST_ASSERT_TRUE(size <= ramp_bound + half);
        TEST_ASSERT_TRUE(size <= in_Nm(torque_max(input.torque_max_Nm, input.f_max_Nm)) + half);
        TEST_ASSERT_FALSE(torque > 0.0f && input.position_inc >= 1000);
        TEST_ASSERT_FALSE(torque < 0.0f && input.position_inc <= -1000);
        TEST_ASSERT_TRUE(output.reasons != 0U || absolute(torque - asked) <= half);
    }
}
