/* Two-plateau profile: each piece, its borders, and its shape as a whole. */
#include "unity.h"

#include "control/torque_profile.h"

static const torque_profile_t profile = {
    .q_a_rad = 0.0075f, .q_p_rad = 0.009f, .q_b_rad = 0.016f, .t1_Nm = 2.0f, .t2_Nm = 5.0f};

void setUp(void) {}
void tearDown(void) {}

static void expect(float torque_Nm, float a_rad) {
    TEST_ASSERT_FLOAT_WITHIN(1e-5f, torque_Nm, torque_profile(&profile, a_rad));
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
        const float now = torque_profile(&profile, (float)i * 1e-6f);
        TEST_ASSERT_TRUE(now >= before);
        TEST_ASSERT_TRUE(now - before < 1e-3f);
        before = now;
    }
}

void test_without_second_slope(void) {
    torque_profile_t step = profile;
    step.q_b_rad = step.q_p_rad;
    TEST_ASSERT_EQUAL_FLOAT(2.0f, torque_profile(&step, 0.009f));
    TEST_ASSERT_EQUAL_FLOAT(5.0f, torque_profile(&step, 0.0091f));
}
