/* The joint of a motor node that runs alone, against the closed form of its motion. */
#include "unity.h"

#include <math.h>

#include "port/posix/simulated_joint.h"

static simulated_joint_config_t config;
static simulated_joint_t joint;

void setUp(void) {
    config = (simulated_joint_config_t){.inertia_kg_m2 = 0.05,
                                        .viscous_Nm_s = 0.0,
                                        .coulomb_Nm = 0.0,
                                        .torque_constant_Nm_A = 5.0,
                                        .index_rad = 1.0,
                                        .increments_per_revolution = 65536};
    joint = (simulated_joint_t){0};
}
void tearDown(void) {}

static void advance(double torque_Nm, int milliseconds) {
    for (int i = 0; i < milliseconds; i++) {
        simulated_joint_advance(&config, torque_Nm, 1000, &joint);
    }
}

void test_constant_torque_accelerates_the_inertia(void) {
    advance(0.5, 100); /* 10 rad/s^2 */
    TEST_ASSERT_FLOAT_WITHIN(1e-5F, 1.0F, (float)joint.speed_rad_s);
    TEST_ASSERT_FLOAT_WITHIN(1e-4F, 0.05F, (float)joint.angle_rad);
    TEST_ASSERT_INT_WITHIN(1, (int)(0.05 / 6.283185307 * 65536.0),
                           simulated_joint_position_inc(&config, &joint));
}

void test_coulomb_friction_holds_and_stops(void) {
    config.coulomb_Nm = 0.2;
    advance(0.19, 1000);
    TEST_ASSERT_TRUE(joint.speed_rad_s == 0.0);
    advance(-0.3, 100);
    TEST_ASSERT_FLOAT_WITHIN(1e-4F, -0.2F, (float)joint.speed_rad_s);
    advance(0.0, 60); /* 4 rad/s^2 against 0.2 rad/s */
    TEST_ASSERT_TRUE(joint.speed_rad_s == 0.0);
}

void test_viscous_friction_ends_the_acceleration(void) {
    config.viscous_Nm_s = 0.5;
    advance(1.0, 2000);
    TEST_ASSERT_FLOAT_WITHIN(1e-4F, 2.0F, (float)joint.speed_rad_s);
}

void test_index_pulse_once_per_revolution_at_one_place(void) {
    config.viscous_Nm_s = 0.5;
    int pulses = 0;
    int32_t first_inc = 0;
    for (int i = 0; i < 10000; i++) {
        const double torque_Nm = i < 5000 ? 1.0 : -1.0; /* 10 rad there, 10 rad back */
        simulated_joint_advance(&config, torque_Nm, 1000, &joint);
        if (joint.index_seen) {
            first_inc = pulses == 0 ? joint.index_position_inc : first_inc;
            TEST_ASSERT_EQUAL_INT32(0, (joint.index_position_inc - first_inc) % 65536);
            pulses++;
        }
    }
    TEST_ASSERT_EQUAL_INT32(10430, first_inc); /* 1 rad */
    TEST_ASSERT_EQUAL_INT(4, pulses);          /* 1 rad and 1 rad + 2 pi, twice */
}

void test_current_of_a_torque(void) {
    TEST_ASSERT_EQUAL_UINT32(1000, simulated_joint_current_mA(&config, -5.0));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, simulated_joint_current_mA(&config, 1e30));
}

void test_an_encoder_the_wrong_way_round_counts_down_from_where_it_stands(void) {
    config.angle_rad = 0.5;
    config.encoder_sign = -1;
    const int32_t start_inc = simulated_joint_position_inc(&config, &joint);
    TEST_ASSERT_INT_WITHIN(1, (int)(0.5 / 6.283185307 * 65536.0), start_inc);
    advance(0.5, 100);
    TEST_ASSERT_INT_WITHIN(2, start_inc - (int)(0.05 / 6.283185307 * 65536.0),
                           simulated_joint_position_inc(&config, &joint));
}
