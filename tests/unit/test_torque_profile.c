/* Two-plateau profile: each piece, its borders, and its shape as a whole. */
#include "unity.h"

#include "control/torque_profile.h"
#include "numbers.h"

static torque_profile_t profile;

void setUp(void) {
    profile.q_a_rad = angle_of(0.0075f);
    profile.q_p_rad = angle_of(0.009f);
    profile.q_b_rad = angle_of(0.016f);
    profile.t1_Nm = torque_of(2.0f);
    profile.t2_Nm = torque_of(5.0f);
}
void tearDown(void) {}

static void expect(float torque_Nm, float a_rad) {
    TEST_ASSERT_FLOAT_WITHIN(2e-5f, torque_Nm, in_Nm(torque_profile(&profile, angle_of(a_rad))));
}

void test_first_slope(void) {
    expect(0.0f, 0.0f);
    expect(1.0f, 0.00375f);
}

void test_first_plateau(void) {
    expect(2.0f, 0.0075f);
    expect(2.0f, 0.008f);
    expect(2.0f, 0.009f);
}

void test_second_slope(void) {
    expect(3.5f, 0.0125f);
}

void test_second_plateau(void) {
    expect(5.0f, 0.016f);
    expect(5.0f, 0.5f);
}

void test_never_falls_and_has_no_step(void) {
    float before = 0.0f;
    for (int i = 0; i <= 20000; i++) {
        const float now = in_Nm(torque_profile(&profile, angle_of((float)i * 1e-6f)));
        TEST_ASSERT_TRUE(now >= before);
        TEST_ASSERT_TRUE(now - before < 1e-3f);
        before = now;
    }
}

void test_without_second_slope(void) {
    profile.q_b_rad = profile.q_p_rad;
    expect(2.0f, 0.009f);
    expect(5.0f, 0.0091f);
}
