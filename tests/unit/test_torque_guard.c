/* Torque guard: each bound alone, with its reason, and all of them on random input. */
#include "unity.h"

#include "control/torque_guard.h"
#include "numbers.h"

static torque_guard_input_t input;

void setUp(void) {
    const torque_guard_input_t free_motion = {
        .torque_Nm = torque_of(3.0f),
        .elapsed_us = 1000,
        .slope_mNm_s = TORQUE_GUARD_SLOPE_OFF,
        .torque_limit_Nm = torque_of(20.0f),
        .ramp_ppm = TORQUE_GUARD_RAMP_FULL,
        .torque_max_Nm = torque_of(8.0f),
        .f_max_Nm = torque_of(2.0f),
        .position_min_inc = -1000,
        .position_max_inc = 1000,
        .moving = 1,
        .motor = {.temperature_dC = 250,
                  .temperature_begin_dC = 1000,
                  .temperature_end_dC = 1200,
                  .speed_begin_ppm = 900000},
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

void test_temperature_derates_the_limit(void) {
    input.torque_Nm = torque_of(7.0f);
    input.motor.temperature_dC = 1150;
    expect(5000, LIMIT_REASON_TEMPERATURE | LIMIT_REASON_TORQUE_LIMIT);
    input.torque_Nm = torque_of(-7.0f);
    expect(-5000, LIMIT_REASON_TEMPERATURE | LIMIT_REASON_TORQUE_LIMIT);
    input.motor.temperature_dC = 1200;
    expect(0, LIMIT_REASON_TEMPERATURE | LIMIT_REASON_TORQUE_LIMIT);
}

void test_current_derates_the_limit(void) {
    input.torque_Nm = torque_of(7.0f);
    input.motor.load_ppm = 1750000;
    expect(5000, LIMIT_REASON_CURRENT | LIMIT_REASON_TORQUE_LIMIT);
}

void test_speed_derates_the_limit_in_the_direction_of_motion(void) {
    input.torque_Nm = torque_of(7.0f);
    input.motor.speed_ppm = 975000;
    expect(5000, LIMIT_REASON_SPEED | LIMIT_REASON_TORQUE_LIMIT);
    input.moving = -1;
    expect(7000, 0);
    input.torque_Nm = torque_of(-7.0f);
    expect(-5000, LIMIT_REASON_SPEED | LIMIT_REASON_TORQUE_LIMIT);
    input.moving = 0;
    expect(-7000, 0);
    input.moving = 1;
    expect(-7000, 0);
}

void test_the_ramp_acts_on_the_derated_limit(void) {
    input.torque_Nm = torque_of(7.0f);
    input.motor.temperature_dC = 1150;
    input.ramp_ppm = 500000;
    expect(2500, LIMIT_REASON_TEMPERATURE | LIMIT_REASON_TORQUE_LIMIT | LIMIT_REASON_BOUND_RAMP);
}

void test_slope_bounds_the_change(void) {
    input.slope_mNm_s = 500000;
    expect(500, LIMIT_REASON_TORQUE_SLOPE);
    input.torque_before_Nm = torque_of(2.5f);
    expect(3000, 0);
    input.torque_before_Nm = torque_of(2.4f);
    input.elapsed_us = 200;
    expect(2500, LIMIT_REASON_TORQUE_SLOPE);
    input.torque_Nm = torque_of(-3.0f);
    expect(2300, LIMIT_REASON_TORQUE_SLOPE);
    input.elapsed_us = 0;
    expect(2400, LIMIT_REASON_TORQUE_SLOPE);
    input.slope_mNm_s = TORQUE_GUARD_SLOPE_OFF - 1U; /* the steepest one */
    input.elapsed_us = 1000000;
    expect(-3000, 0);
}

void test_slope_in_whole_and_in_many_ticks(void) {
    /* From -2 to 3 N m at 1 N m/s: 5 s, whatever the tick; one step of torque_t a tick is lost. */
    static const uint32_t tick_us[] = {100, 333, 1000, 100000};
    for (size_t i = 0; i < sizeof tick_us / sizeof tick_us[0]; i++) {
        uint32_t time_us = 0;
        input.slope_mNm_s = 1000;
        input.elapsed_us = tick_us[i];
        input.torque_before_Nm = torque_of(-2.0f);
        while (input.torque_before_Nm < input.torque_Nm && time_us < 6000000U) {
            input.torque_before_Nm = torque_guard(&input).torque_Nm;
            time_us += tick_us[i];
        }
        const float lost_part = TORQUE_STEP_Nm / ((float)tick_us[i] * 1e-6f);
        TEST_ASSERT_FLOAT_WITHIN(5.0f * 0.5f * lost_part + 0.11f, 5.0f, (float)time_us * 1e-6f);
    }
}

void test_bounds_win_over_the_slope(void) {
    input.slope_mNm_s = 1000;
    input.torque_before_Nm = torque_of(3.0f);
    input.ramp_ppm = 50000;
    expect(1000, LIMIT_REASON_BOUND_RAMP);
    setUp();
    input.slope_mNm_s = 1000;
    input.torque_before_Nm = torque_of(3.0f);
    input.position_inc = 1000;
    expect(0, LIMIT_REASON_POSITION_LIMIT);
    TEST_ASSERT_EQUAL_INT(0, (int)torque_guard(&input).torque_Nm);
    setUp();
    input.slope_mNm_s = 1000;
    input.torque_before_Nm = torque_of(10.0f);
    expect(8000, LIMIT_REASON_TORQUE_SLOPE | LIMIT_REASON_TORQUE_MAX);
}

void test_bounds_hold_for_random_input(void) {
    uint32_t state = 1;
    for (int i = 0; i < 200000; i++) {
        uint32_t value[10];
        for (int j = 0; j < 10; j++) {
            state = state * 1664525U + 1013904223U;
            value[j] = state >> 8;
        }
        input.torque_Nm = torque_of(((float)value[0] - 8388608.0f) * 1e-5f);
        input.torque_limit_Nm = torque_of((float)value[1] * 1.9e-6f);
        input.torque_max_Nm = torque_of((float)value[2] * 1.9e-6f);
        input.f_max_Nm = torque_of((float)value[3] * 1.9e-6f);
        input.ramp_ppm = value[4] % 1000001U;
        input.position_inc = (int32_t)(value[5] % 2400U) - 1200;
        input.torque_before_Nm = torque_of(((float)value[6] - 8388608.0f) * 3e-6f);
        input.slope_mNm_s = i % 4 == 0 ? 1000U + value[6] * 2U : TORQUE_GUARD_SLOPE_OFF;
        input.moving = (int8_t)((int32_t)(value[7] % 3U) - 1);
        input.motor.temperature_dC = (int16_t)(value[7] >> 9 & 0x7FFU);
        input.motor.load_ppm = value[8] % 2200000U;
        input.motor.speed_ppm = value[9] % 1200000U;
        const torque_guard_output_t output = torque_guard(&input);
        const float asked = in_Nm(input.torque_Nm);
        const float torque = (float)output.torque_mNm * 0.001f;
        const float half = 0.00051f + TORQUE_STEP_Nm; /* rounding to whole mN m */
        const float size = absolute(torque);
        const float ramp_bound = in_Nm(input.torque_limit_Nm) * (float)input.ramp_ppm * 1e-6f;
        const float before = absolute(in_Nm(input.torque_before_Nm));
        const bool slow = input.slope_mNm_s != TORQUE_GUARD_SLOPE_OFF;
        const float step = (float)input.slope_mNm_s * 1e-6f; /* in 1 ms */
        TEST_ASSERT_TRUE(size <= absolute(asked) + half || (slow && size <= before + half));
        TEST_ASSERT_TRUE(!slow || size <= before + step + half);
        TEST_ASSERT_TRUE(size <= ramp_bound + half);
        TEST_ASSERT_TRUE(size <= in_Nm(torque_max(input.torque_max_Nm, input.f_max_Nm)) + half);
        TEST_ASSERT_FALSE(torque > 0.0f && input.position_inc >= 1000);
        TEST_ASSERT_FALSE(torque < 0.0f && input.position_inc <= -1000);
        TEST_ASSERT_TRUE(output.reasons != 0U || absolute(torque - asked) <= half);
    }
}
