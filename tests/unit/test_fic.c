/*
 * Fractal impedance controller: every branch of both phase rules, and passivity as a property.
 *
 * Most tests use an encoder of 1 increment = 1 mrad and a single slope F(a) = 100 a, so that
 * figures can be read: target 0, e = -q.
 */
#include "unity.h"

#include "control/fic.h"
#include "numbers.h"

#define TICK_us 1000U

static torque_profile_t slope;
static fic_config_t config;
static fic_t fic;
static int32_t target_inc;

static torque_profile_t slope_up_to(float torque_Nm) {
    const torque_profile_t profile = {.q_a_rad = angle_of(0.1f),
                                      .q_p_rad = angle_of(0.1f),
                                      .q_b_rad = angle_of(0.1f),
                                      .t1_Nm = torque_of(torque_Nm),
                                      .t2_Nm = torque_of(torque_Nm)};
    return profile;
}

void setUp(void) {
    slope = slope_up_to(10.0f);
    config.phase_rule = FIC_BODY_MOTION;
    config.delta_inc256 = 128;
    config.delta_rad = angle_of(0.0005f);
    config.stall_time_us = 20000;
    target_inc = 0;
    fic_reset(0, &fic);
}
void tearDown(void) {}

static float step_with(const torque_profile_t *profile, int32_t position_inc) {
    const float error_rad = ((float)target_inc - (float)position_inc) * 0.001f;
    const float limited_rad = error_rad > 0.5f ? 0.5f : error_rad < -0.5f ? -0.5f : error_rad;
    const fic_input_t input = {
        .position_inc = position_inc, .error_rad = angle_of(limited_rad), .elapsed_us = TICK_us};
    return in_Nm(fic_step(&config, profile, &input, &fic));
}

static float step(int32_t position_inc) {
    return step_with(&slope, position_inc);
}

static void expect(float torque_Nm, int32_t position_inc) {
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, torque_Nm, step(position_inc));
}

/** Divergence to 20 mrad, then the first step back. */
static void swing_out(int32_t sign) {
    for (int32_t q = 0; q <= 20; q++) {
        (void)step(sign * q);
    }
}

void test_divergence_pulls_back_along_the_profile(void) {
    expect(0.0f, 0);
    expect(-0.5f, 5);
    expect(-2.0f, 20);
    TEST_ASSERT_FALSE(fic.converging);
}

void test_divergence_on_the_other_side(void) {
    expect(0.5f, -5);
    expect(2.0f, -20);
    TEST_ASSERT_FALSE(fic.converging);
}

void test_convergence_is_a_spring_about_the_middle(void) {
    swing_out(1);
    expect(-2.0f * (15.0f - 10.0f) / 10.0f, 15);
    TEST_ASSERT_TRUE(fic.converging);
    expect(0.0f, 10);
    expect(2.0f * (10.0f - 5.0f) / 10.0f, 5); /* brakes in the second half */
    expect(2.0f * (10.0f - 1.0f) / 10.0f, 1);
}

void test_convergence_on_the_other_side(void) {
    swing_out(-1);
    expect(1.0f, -15);
    expect(-1.0f, -5);
}

void test_f_max_stays_latched_when_the_profile_changes(void) {
    swing_out(1);
    const torque_profile_t weaker = slope_up_to(1.0f);
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, 1.0f, step_with(&weaker, 5));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 2.0f, in_Nm(fic.f_max_Nm));
}

void test_convergence_never_exceeds_the_profile(void) {
    swing_out(1);
    const torque_profile_t weaker = slope_up_to(1.0f);
    TEST_ASSERT_FLOAT_WITHIN(1e-4f, -0.19f, step_with(&weaker, 19));
}

void test_reversal_outward_is_divergence_at_once(void) {
    swing_out(1);
    (void)step(12);
    expect(-1.3f, 13);
    TEST_ASSERT_FALSE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.013f, in_rad(fic.a_max_rad));
}

void test_zero_crossing_latches_anew(void) {
    swing_out(1);
    (void)step(1);
    TEST_ASSERT_TRUE(fic.converging);
    expect(0.2f, -2); /* other side, moving away */
    TEST_ASSERT_FALSE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.002f, in_rad(fic.a_max_rad));
    TEST_ASSERT_FLOAT_WITHIN(TORQUE_STEP_Nm, 0.2f, in_Nm(fic.f_max_Nm));
}

void test_target_jumping_across_latches_while_converging(void) {
    swing_out(1);
    (void)step(19); /* moves down, toward 0 */
    target_inc = 15;
    (void)step(18);
    TEST_ASSERT_TRUE(fic.converging);
    target_inc = 30; /* the error changes sign; the body still moves down: away */
    expect(1.3f, 17);
    TEST_ASSERT_FALSE(fic.converging);
}

void test_body_and_target_turning_together_latch_anew(void) {
    swing_out(1);
    (void)step(15);
    TEST_ASSERT_TRUE(fic.converging);
    target_inc = 20;
    expect(0.4f, 16); /* now moves up, toward the new target: converging from 4, not from 20 */
    TEST_ASSERT_TRUE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.004f, in_rad(fic.a_max_rad));
}

void test_error_beyond_the_latch_moves_the_latch_while_converging(void) {
    swing_out(1);
    (void)step(19);
    target_inc = -10; /* |e| grows to 28 although the body moves toward the target */
    expect(-2.8f, 18);
    TEST_ASSERT_TRUE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.028f, in_rad(fic.a_max_rad));
}

void test_error_of_zero_has_no_torque_and_no_division(void) {
    expect(0.0f, 0);
    expect(0.0f, 0);
    TEST_ASSERT_EQUAL_FLOAT(0.0f, in_rad(fic.a_max_rad));
}

void test_motion_of_delta_or_less_is_no_reversal(void) {
    config.delta_inc256 = 3 * 256;
    swing_out(1);
    (void)step(17);
    TEST_ASSERT_FALSE(fic.converging);
    (void)step(16);
    TEST_ASSERT_TRUE(fic.converging);
}

void test_direction_is_forgotten_after_the_stall_time(void) {
    swing_out(1);
    (void)step(15);
    for (int i = 0; i < 19; i++) {
        (void)step(15);
        TEST_ASSERT_TRUE(fic.converging);
    }
    (void)step(15);
    TEST_ASSERT_FALSE(fic.converging);
    expect(-1.5f, 15);
    (void)step(14); /* same direction again: known at once */
    TEST_ASSERT_TRUE(fic.converging);
}

void test_age_does_not_wrap(void) {
    swing_out(1);
    (void)step(15);
    fic.age_us = UINT32_MAX - 5U;
    (void)step(15);
    TEST_ASSERT_FALSE(fic.converging);
}

void test_upward_reversal_of_direction(void) {
    swing_out(-1);
    (void)step(-19);
    TEST_ASSERT_EQUAL_INT8(1, fic.direction);
    TEST_ASSERT_TRUE(fic.converging);
    (void)step(-19);
    (void)step(-17);
    TEST_ASSERT_EQUAL_INT32(-17, fic.extreme_inc);
}

void test_motion_of_delta_or_less_is_no_reversal_upward(void) {
    config.delta_inc256 = 3 * 256;
    swing_out(-1);
    (void)step(-17);
    TEST_ASSERT_EQUAL_INT8(-1, fic.direction);
    TEST_ASSERT_FALSE(fic.converging);
    (void)step(-16);
    TEST_ASSERT_EQUAL_INT8(1, fic.direction);
    TEST_ASSERT_TRUE(fic.converging);
}

void test_first_motion_upward_has_no_direction_until_it_turns(void) {
    for (int32_t q = -20; q < -10; q++) {
        if (q == -20) {
            fic_reset(q, &fic);
        }
        (void)step(q);
        TEST_ASSERT_FALSE(fic.converging);
    }
    TEST_ASSERT_EQUAL_INT8(0, fic.direction);
}

void test_positions_at_the_ends_of_the_range(void) {
    fic_reset(INT32_MAX, &fic);
    (void)step(INT32_MAX);
    (void)step(INT32_MIN);
    TEST_ASSERT_EQUAL_INT8(-1, fic.direction);
    (void)step(INT32_MAX);
    TEST_ASSERT_EQUAL_INT8(1, fic.direction);
}

void test_error_growth_follows_the_error(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    swing_out(1);
    TEST_ASSERT_FALSE(fic.converging);
    expect(-1.0f, 15);
    TEST_ASSERT_TRUE(fic.converging);
    expect(1.0f, 5);
    expect(-1.0f, 10); /* the error grows again: divergence */
}

void test_error_growth_turns_back_to_divergence(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    swing_out(1);
    (void)step(5);
    expect(-0.8f, 8);
    TEST_ASSERT_FALSE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.008f, in_rad(fic.a_max_rad));
}

void test_error_growth_within_delta_keeps_the_phase(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    config.delta_rad = angle_of(0.0025f);
    swing_out(1);
    (void)step(18);
    TEST_ASSERT_FALSE(fic.converging);
    (void)step(17);
    TEST_ASSERT_TRUE(fic.converging);
    (void)step(19);
    TEST_ASSERT_TRUE(fic.converging);
    (void)step(20);
    TEST_ASSERT_FALSE(fic.converging);
}

void test_error_growth_with_a_moving_target(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    swing_out(1);
    target_inc = 10; /* the body stands still, the error shrinks: convergence by the error alone */
    (void)step(20);
    TEST_ASSERT_TRUE(fic.converging);
}

void test_error_growth_zero_crossing(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    swing_out(1);
    (void)step(5);
    TEST_ASSERT_TRUE(fic.converging);
    expect(0.3f, -3);
    TEST_ASSERT_FALSE(fic.converging);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.003f, in_rad(fic.a_max_rad));
}

/* Passivity: with a fixed target no closed cycle of q gains energy. */

static uint32_t random_state;

static uint32_t random_below(uint32_t bound) {
    random_state = random_state * 1664525U + 1013904223U;
    return (uint32_t)(((uint64_t)random_state * bound) >> 32);
}

static torque_profile_t random_profile(void) {
    const uint32_t q_a_urad = 1000U + random_below(8000);
    const uint32_t q_p_urad = q_a_urad + random_below(3000);
    const uint32_t q_b_urad = q_p_urad + 100U + random_below(8000);
    const torque_t t2 = torque_from_mNm((int32_t)(500U + random_below(3000)), 1);
    const torque_profile_t profile = {.q_a_rad = angle_from_urad(q_a_urad),
                                      .q_p_rad = angle_from_urad(q_p_urad),
                                      .q_b_rad = angle_from_urad(q_b_urad),
                                      .t1_Nm = torque_part(t2, random_below(1001), 1000),
                                      .t2_Nm = t2};
    return profile;
}

typedef struct {
    double gained_J;
    double tolerance_J;
    bool keep_min; /* false: the plain spring in convergence */
    int32_t position_inc;
    float torque_Nm;
    angle_scale_t scale;
    double step_rad;
} cycle_t;

static void move_to(const torque_profile_t *profile, int32_t goal_inc, cycle_t *cycle) {
    const int32_t direction = goal_inc > cycle->position_inc ? 1 : -1;
    while (cycle->position_inc != goal_inc) {
        cycle->position_inc += direction;
        const fic_input_t input = {.position_inc = cycle->position_inc,
                                   .error_rad =
                                       angle_from_steps(&cycle->scale, -cycle->position_inc),
                                   .elapsed_us = 1};
        float torque = in_Nm(fic_step(&config, profile, &input, &fic));
        if (fic.converging && !cycle->keep_min) {
            const float a_max = in_rad(fic.a_max_rad);
            const float a = in_rad(angle_abs(input.error_rad));
            const float spring = in_Nm(fic.f_max_Nm) * (2.0f * a - a_max) / a_max;
            torque = input.error_rad < 0 ? -spring : spring;
        }
        cycle->gained_J += 0.5 * (double)(torque + cycle->torque_Nm) * cycle->step_rad * direction;
        cycle->torque_Nm = torque;
    }
    /* The turn itself is seen one increment late. */
    cycle->tolerance_J += 2.0 * (double)in_Nm(profile->t2_Nm) * cycle->step_rad;
}

static double largest_gain_of_random_cycles(bool keep_min) {
    const uint32_t resolution = 1U << 24; /* fine, so that the tolerance is small */
    double largest = -1.0;
    random_state = 20210501U;
    for (int run = 0; run < 100; run++) {
        const torque_profile_t profile = random_profile();
        const int32_t begin = (int32_t)random_below(80000) - 40000;
        cycle_t cycle = {.keep_min = keep_min,
                         .position_inc = begin,
                         .scale = angle_scale(resolution, 1),
                         .step_rad = 6.283185307179586 / (double)resolution};
        config.delta_rad = angle_part(cycle.scale.step_rad, 1, 2);
        fic_reset(begin, &fic);
        const int turns = 1 + (int)random_below(4);
        for (int turn = 0; turn < turns; turn++) {
            move_to(&profile, (int32_t)random_below(96000) - 48000, &cycle);
        }
        move_to(&profile, begin, &cycle);
        const double gain = cycle.gained_J - cycle.tolerance_J;
        largest = gain > largest ? gain : largest;
    }
    return largest;
}

void test_no_closed_cycle_gains_energy(void) {
    TEST_ASSERT_TRUE(largest_gain_of_random_cycles(true) <= 0.0);
}

void test_no_closed_cycle_gains_energy_by_error_growth(void) {
    config.phase_rule = FIC_ERROR_GROWTH;
    TEST_ASSERT_TRUE(largest_gain_of_random_cycles(true) <= 0.0);
}

void test_the_spring_without_the_profile_as_bound_would_gain_energy(void) {
    TEST_ASSERT_TRUE(largest_gain_of_random_cycles(false) > 1e-4);
}
