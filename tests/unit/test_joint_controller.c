/* Joint torque controller: interpolation between SYNCs, hold, profile from the command, limit. */
#include "unity.h"

#include "control/joint_controller.h"
#include "numbers.h"

static joint_controller_config_t config;
static joint_controller_t controller;
static joint_controller_output_t output;

static void use_ticks(uint8_t ticks_per_sync) {
    config.ticks_per_sync = ticks_per_sync;
    config.scale = angle_scale(65536, ticks_per_sync);
}

void setUp(void) {
    const joint_controller_config_t paper = {
        .fic = {.phase_rule = FIC_BODY_MOTION, .delta_inc256 = 128, .stall_time_us = 20000},
        .q_a_rad = angle_of(0.0075f),
        .q_p_rad = angle_of(0.009f),
        .q_b_rad = angle_of(0.016f),
        .torque_limit_Nm = torque_of(20.0f),
    };
    const joint_command_t none = {0};
    config = paper;
    use_ticks(1);
    joint_controller_reset(0, &none, &controller);
}
void tearDown(void) {}

static void command(int32_t position_inc, int16_t torque_mNm, uint16_t torque_max_mNm) {
    const joint_command_t given = {position_inc, torque_mNm, torque_max_mNm};
    joint_controller_command(&given, &controller);
}

static void tick(int32_t position_inc) {
    joint_controller_step(&config, position_inc, 1000U / config.ticks_per_sync, &controller,
                          &output);
}

void test_command_acts_at_once_with_one_tick_per_sync(void) {
    command(100, 3000, 8000);
    tick(0);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 100.0f * 9.58738e-5f, in_rad(output.error_rad));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 8.0f, in_Nm(output.torque_max_Nm));
    TEST_ASSERT_FLOAT_WITHIN(1e-3f, 3.0f + 5.0f * (9.58738e-3f - 9e-3f) / 7e-3f,
                             in_Nm(output.torque_Nm));
}

void test_five_ticks_interpolate_from_the_command_before(void) {
    use_ticks(5);
    command(100, 1000, 2000);
    command(110, 2000, 4000);
    for (int i = 0; i < 5; i++) {
        tick(50);
        TEST_ASSERT_FLOAT_WITHIN(1e-7f, (50.0f + 2.0f * (float)i) * 9.58738e-5f,
                                 in_rad(output.error_rad));
        TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 2.0f + 0.4f * (float)i,
                                 in_Nm(output.torque_max_Nm));
    }
}

void test_late_command_holds_the_end_point(void) {
    use_ticks(5);
    command(100, 1000, 2000);
    command(110, 2000, 4000);
    for (int i = 0; i < 12; i++) {
        tick(50);
    }
    TEST_ASSERT_FLOAT_WITHIN(1e-7f, 60.0f * 9.58738e-5f, in_rad(output.error_rad));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 4.0f, in_Nm(output.torque_max_Nm));
}

void test_first_plateau_is_the_smaller_of_both_torques(void) {
    command(80, 9000, 2000); /* e = 7.67 mrad: on the first plateau */
    tick(0);
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 2.0f, in_Nm(output.torque_Nm));
    command(80, -1000, 2000); /* only the size of T_d counts */
    tick(0);
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 1.0f, in_Nm(output.torque_Nm));
}

void test_sign_of_the_torque_is_that_of_the_error(void) {
    command(-80, 1000, 2000);
    tick(0);
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, -1.0f, in_Nm(output.torque_Nm));
}

void test_torque_is_limited_to_TA(void) {
    config.torque_limit_Nm = torque_of(5.0f);
    command(2000, 8000, 8000);
    tick(0);
    TEST_ASSERT_EQUAL_FLOAT(5.0f, in_Nm(output.torque_Nm));
    TEST_ASSERT_TRUE(output.limited);
    command(2, 8000, 8000);
    tick(0);
    TEST_ASSERT_FALSE(output.limited);
}

void test_braking_may_exceed_a_falling_T_max(void) {
    command(300, 4000, 4000);
    tick(0);
    tick(1);
    tick(0); /* turns: now the body moves down */
    command(-300, 4000, 4000);
    tick(0);
    TEST_ASSERT_EQUAL_FLOAT(-4.0f, in_Nm(output.torque_Nm));
    for (int32_t q = -1; q > -295; q--) {
        tick(q);
    }
    command(-300, 500, 500);
    tick(-295);
    TEST_ASSERT_TRUE(in_Nm(output.torque_Nm) > 3.0f);
    TEST_ASSERT_FLOAT_WITHIN(1e-3f, 4.0f, in_Nm(output.f_max_Nm));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 0.5f, in_Nm(output.torque_max_Nm));
}

void test_hold_replaces_the_position_only(void) {
    use_ticks(5);
    command(100, 1000, 2000);
    command(110, 1000, 2000);
    joint_controller_hold(70, &controller);
    tick(70);
    TEST_ASSERT_EQUAL_FLOAT(0.0f, in_rad(output.error_rad));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 2.0f, in_Nm(output.torque_max_Nm));
    for (int i = 0; i < 5; i++) {
        tick(0);
    }
    TEST_ASSERT_FLOAT_WITHIN(1e-7f, 70.0f * 9.58738e-5f, in_rad(output.error_rad));
}

void test_hold_while_converging_does_not_jolt(void) {
    config.fic.phase_rule = FIC_ERROR_GROWTH;
    command(300, 4000, 4000);
    for (int32_t q = 0; q < 250; q += 10) {
        tick(q);
    }
    TEST_ASSERT_TRUE(controller.fic.converging);
    joint_controller_hold(250, &controller);
    tick(250);
    TEST_ASSERT_EQUAL_FLOAT(0.0f, in_Nm(output.torque_Nm));
}

void test_extremes_of_the_position_range(void) {
    use_ticks(10);
    command(INT32_MIN, -32767, 32767);
    command(INT32_MAX, 32767, 32767);
    for (int i = 0; i < 11; i++) {
        tick(INT32_MIN);
        tick(INT32_MAX);
        TEST_ASSERT_TRUE(in_rad(angle_abs(output.error_rad)) <= 0.5001f);
        TEST_ASSERT_TRUE(in_Nm(torque_abs(output.torque_Nm)) <= 20.0f);
    }
}

void test_reset_starts_the_fic_at_rest(void) {
    const joint_command_t given = {200, 1000, 1000};
    command(100, 1000, 1000);
    tick(50);
    tick(20);
    joint_controller_reset(40, &given, &controller);
    TEST_ASSERT_EQUAL_INT8(0, controller.fic.direction);
    TEST_ASSERT_EQUAL_INT32(40, controller.fic.extreme_inc);
    tick(40);
    TEST_ASSERT_FLOAT_WITHIN(1e-7f, 160.0f * 9.58738e-5f, in_rad(output.error_rad));
    TEST_ASSERT_FALSE(controller.fic.converging);
}
