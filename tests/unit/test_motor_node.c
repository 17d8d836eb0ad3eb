/* The whole node, driven by frames: a life from power-on to stop, and what belongs to a normal run.
 */
#include "unity.h"

#include "node_rig.h"

void setUp(void) {
    rig_init();
}
void tearDown(void) {}

static uint16_t statusword(void) {
    const can_frame_t *tpdo1 = rig_sent(0x182);
    TEST_ASSERT_NOT_NULL(tpdo1);
    return (uint16_t)(tpdo1->data[6] | tpdo1->data[7] << 8);
}

static int16_t torque_mNm(void) {
    const can_frame_t *tpdo1 = rig_sent(0x182);
    TEST_ASSERT_NOT_NULL(tpdo1);
    return (int16_t)(uint16_t)(tpdo1->data[4] | tpdo1->data[5] << 8);
}

static void expect_state(uint16_t bits) {
    TEST_ASSERT_EQUAL_HEX16(bits, statusword() & 0x6FU);
}

void test_boot_up_comes_first_and_once(void) {
    rig_read(0x1000, 0);
    rig_step();
    TEST_ASSERT_EQUAL_UINT(2, rig.output.frame_count);
    TEST_ASSERT_EQUAL_HEX16(0x702, rig.output.frames[0].id);
    TEST_ASSERT_EQUAL_HEX8(0, rig.output.frames[0].data[0]);
    TEST_ASSERT_EQUAL_UINT32(0x00020192, rig_u32(&rig.output.frames[1].data[4]));
    rig_step();
    TEST_ASSERT_EQUAL_UINT(0, rig.output.frame_count);
}

void test_heartbeat_tells_the_state(void) {
    int beats = 0;
    for (int i = 0; i < 300; i++) {
        if (i == 150) {
            rig_nmt(1);
        }
        if (i == 250) {
            rig_nmt(2);
        }
        rig_step();
        const can_frame_t *beat = rig_sent(0x702);
        if (beat != NULL && i > 0) {
            const uint8_t expected[] = {127, 5, 4};
            TEST_ASSERT_EQUAL_UINT8(expected[beats], beat->data[0]);
            beats++;
        }
    }
    TEST_ASSERT_EQUAL_INT(3, beats);
}

void test_life_from_power_on_to_stop(void) {
    rig_step();
    rig_write(0x2100, 4, 2, 20000);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(0, rig_abort());
    rig_write(0x1019, 0, 1, 240);
    rig_step();
    rig_write(0x1006, 0, 4, 1000);
    rig_step();
    rig_nmt(1);
    rig_step();
    rig.sync_counter = 1;
    rig_cycle();
    expect_state(0x60);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    rig_control(0x06, -1);
    rig_cycle();
    expect_state(0x21);
    rig_control(0x07, 0);
    rig_cycle();
    expect_state(0x23);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    rig_control(0x0F, 0);
    rig_cycle();
    expect_state(0x27);
    TEST_ASSERT_TRUE(rig.output.output_enabled);

    rig.desired_inc = 5300; /* beyond q_b: 4 N m once the bound allows it */
    for (int i = 1; i <= 10; i++) {
        rig_cycle();
        TEST_ASSERT_EQUAL_INT16(200 * i, torque_mNm()); /* 1 % of 20 N m each ms */
        TEST_ASSERT_TRUE((statusword() & STATUSWORD_INTERNAL_LIMIT) != 0U);
    }
    rig_cycles(100);
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
    TEST_ASSERT_EQUAL_INT16(4000, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_HEX16(0, statusword() & STATUSWORD_INTERNAL_LIMIT);

    rig.input.position_inc = 5299;
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_TRUE((statusword() & STATUSWORD_TARGET_REACHED) != 0U);
    TEST_ASSERT_TRUE((statusword() & STATUSWORD_FOLLOWS) != 0U);

    rig.input.position_inc = 5000;
    rig_cycles(30);
    rig_control(0x02, 0);
    rig_cycle();
    expect_state(0x07);
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm()); /* holds the measured angle */
    rig.input.position_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(-4000, torque_mNm()); /* and pulls back to it */
    rig_cycles(97);
    TEST_ASSERT_TRUE(torque_mNm() >= -200 && torque_mNm() < 0);
    rig_cycle();
    expect_state(0x60);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    rig_nmt(2);
    rig_cycle();
    TEST_ASSERT_NULL(rig_sent(0x182));
    TEST_ASSERT_EQUAL_HEX8(0, rig.node.od.error_register);
}

void test_enabled_again_it_follows_commands_again(void) {
    rig_run();
    rig_control(0x02, 0);
    rig_cycles(101);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    rig.node.od.counters_missed_sync = 7;
    rig_enable();
    TEST_ASSERT_EQUAL_UINT16(0, rig.node.od.counters_missed_sync);
    rig_cycles(101);
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
    rig.desired_inc = 4700;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(-4000, torque_mNm());
}

void test_no_torque_before_enabling(void) {
    rig_start();
    rig.desired_inc = 5400;
    rig_control(0x06, -1);
    rig_cycles(20);
    rig_control(0x07, 0);
    for (int i = 0; i < 20; i++) {
        rig_cycle();
        TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
        TEST_ASSERT_FALSE(rig.output.output_enabled);
    }
}

void test_command_acts_at_the_sync_after_it(void) {
    rig_run();
    rig_sync();
    rig_command(5300, 3000, 4000); /* behind the SYNC: waits */
    rig_step();
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
}

void test_last_of_several_commands_wins(void) {
    rig_run();
    rig_command(5300, 3000, 4000);
    rig_command(4700, 3000, 4000);
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(-4000, torque_mNm());
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_rpdo1_overwritten);
}

void test_reply_carries_what_was_measured_at_its_sync(void) {
    rig_start();
    rig.input.position_inc = -123456;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(-123456, (int32_t)rig_u32(rig_sent(0x182)->data));
}

void test_no_reply_without_sync_or_outside_operational(void) {
    rig_step();
    rig_sync();
    rig_step();
    TEST_ASSERT_NULL(rig_sent(0x182));
    rig_start();
    rig_command(5000, 0, 0);
    rig_step();
    TEST_ASSERT_NULL(rig_sent(0x182));
}

void test_no_reply_when_stopped_behind_the_sync(void) {
    rig_start();
    rig_sync();
    rig_nmt(2);
    rig_step();
    TEST_ASSERT_NULL(rig_sent(0x182));
}

void test_duplicate_sync_has_no_reply_and_does_not_act(void) {
    rig_write(0x1019, 0, 1, 240);
    rig_start();
    rig.sync_counter = 7;
    rig_cycle();
    rig.sync_counter = 7;
    rig_cycle();
    TEST_ASSERT_NULL(rig_sent(0x182));
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_duplicate_sync);
    rig.sync_counter = 9;
    rig_cycle();
    TEST_ASSERT_NOT_NULL(rig_sent(0x182));
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_sync_counter_jumps);
}

void test_joint_loop_of_five_ticks(void) {
    rig_write(0x2100, 8, 1, 5);
    rig_run();
    rig.input.elapsed_us = 200;
    rig_cycle();
    for (int i = 0; i < 4; i++) {
        rig_step();
    }
    rig_command(5050, 3000, 4000); /* first slope: 3 N m / 7.5 mrad */
    rig_sync();
    for (int i = 0; i < 7; i++) {
        rig_step();
        const int expected = i < 5 ? 10 * i : 50;
        TEST_ASSERT_INT_WITHIN(1, (int)(3000.0 * expected * 9.58738e-5 / 7.5e-3 + 0.5),
                               rig.output.torque_mNm);
        TEST_ASSERT_EQUAL_UINT(i == 0 ? 1 : 0, rig.output.frame_count);
    }
}

void test_injected_sensors(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    TEST_ASSERT_EQUAL_INT32(0, (int32_t)rig_u32(rig_sent(0x182)->data));
    rig_inject(777, 1, 0); /* before SYNC */
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(777, (int32_t)rig_u32(rig_sent(0x182)->data));
    rig_sync();
    rig_inject(778, 2, 0); /* behind SYNC */
    rig_step();
    TEST_ASSERT_EQUAL_INT32(778, (int32_t)rig_u32(rig_sent(0x182)->data));
    TEST_ASSERT_EQUAL_INT16(300, rig.node.od.motor_temperature);
}

void test_a_reference_belongs_to_its_sensor(void) {
    rig.config.referenced = false;
    motor_node_init(&rig.config, &rig.node);
    rig_start();
    TEST_ASSERT_FALSE(rig.node.referenced);
    rig.node.offset_inc = 100; /* homed */
    rig.node.referenced = true;
    rig_write(0x2F00, 0, 1, 0); /* the same again */
    rig_step();
    TEST_ASSERT_TRUE(rig.node.referenced);
    TEST_ASSERT_EQUAL_INT32(5100, rig.node.od.position_actual_value);
    rig_write(0x2F00, 0, 1, 1);
    rig_inject(777, 1, 0);
    rig_step();
    TEST_ASSERT_TRUE(rig.node.referenced); /* injected positions are absolute */
    TEST_ASSERT_EQUAL_INT32(777, rig.node.od.position_actual_value);
    rig_write(0x2F00, 0, 1, 0);
    rig_step();
    TEST_ASSERT_FALSE(rig.node.referenced);
    TEST_ASSERT_EQUAL_INT32(5000, rig.node.od.position_actual_value);
}

void test_a_restart_keeps_what_belongs_to_the_bench(void) {
    rig.config.supervisor_reset = true;
    rig_write(0x2F00, 0, 1, 1);
    rig_write(0x2F01, 0, 1, 1);
    rig_step();
    rig_step();
    motor_node_restart(&rig.config, &rig.node);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.sensor_source);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.time_base);
    TEST_ASSERT_TRUE(rig.node.referenced);
    TEST_ASSERT_FALSE(rig.node.position_known);
    TEST_ASSERT_FALSE(rig.config.supervisor_reset); /* reported once */
}

void test_frames_that_the_port_has_lost_are_counted(void) {
    rig.input.frames_lost = 3;
    rig_step();
    rig.input.frames_lost = UINT32_MAX;
    rig_step();
    TEST_ASSERT_EQUAL_UINT16(UINT16_MAX, rig.node.od.counters_frames_not_read);
}

void test_injected_sensors_are_refused_unless_chosen(void) {
    rig_start();
    rig_inject(777, 1, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(5000, (int32_t)rig_u32(rig_sent(0x182)->data));
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_rpdo4_refused);
    TEST_ASSERT_EQUAL_INT16(251, rig.node.od.motor_temperature);
}

void test_status_pdo_on_change_with_inhibit_time_and_timer(void) {
    rig_start();
    rig_cycles(200);
    int sent = 0;
    for (int i = 0; i < 200; i++) {
        rig_cycle();
        sent += rig_sent(0x282) != NULL ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_INT(2, sent);
    while (rig_sent(0x282) == NULL) {
        rig_cycle();
    }
    rig_control(0x06, -1);
    for (int i = 1; i <= 20; i++) {
        rig_cycle();
        TEST_ASSERT_TRUE((rig_sent(0x282) != NULL) == (i == 20));
    }
    TEST_ASSERT_EQUAL_HEX8(0xFF, rig_sent(0x282)->data[0]);
    TEST_ASSERT_EQUAL_UINT8(7, rig_sent(0x282)->len);
}

static void expect_refused(uint16_t reasons) {
    rig_control(0x06, 0);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(reasons, rig.node.od.limit_reasons);
    TEST_ASSERT_EQUAL_HEX16(0x23, rig.node.od.statusword & 0x6FU);
    TEST_ASSERT_TRUE((rig.node.od.statusword & STATUSWORD_INTERNAL_LIMIT) != 0U);
}

void test_enabling_needs_a_mode(void) {
    rig_start();
    expect_refused(LIMIT_REASON_MODE);
}

void test_enabling_needs_a_reference(void) {
    rig.config.referenced = false;
    motor_node_init(&rig.config, &rig.node);
    rig_start();
    TEST_ASSERT_EQUAL_HEX16(0, statusword() & STATUSWORD_REFERENCED);
    rig_control(0x00, -1);
    expect_refused(LIMIT_REASON_NOT_REFERENCED);
}

void test_enabling_needs_the_desired_angle_near_the_measured(void) {
    rig_start();
    rig_control(0x00, -1);
    rig.desired_inc = 5000 + 522;
    expect_refused(LIMIT_REASON_OUTSIDE_WINDOW);
    rig.desired_inc = 5000 - 521;
    rig_cycle();
    rig_control(0x0F, 0); /* asked again: granted, and the reason is gone */
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.limit_reasons & 0xFF00U);
}

void test_enabling_needs_a_fresh_command(void) {
    rig_start();
    rig_control(0x06, -1);
    rig_cycle();
    for (int i = 0; i < 5; i++) {
        rig_command(5000, 0, 0); /* without SYNC it does not act */
        rig_step();
    }
    rig_control(0x0F, 0);
    rig_step();
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_NO_COMMAND, rig.node.od.limit_reasons);
}

void test_command_from_before_the_start_is_not_fresh(void) {
    rig_write(0x1400, 5, 2, 0);
    rig_start();
    rig_control(0x06, -1);
    rig_cycle();
    rig_nmt(128);
    rig_step();
    rig_write(0x6040, 0, 2, 0x0F); /* not operational */
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_NO_COMMAND, rig.node.od.limit_reasons);
    rig_nmt(1);
    rig_control(0x0F, 0);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_NO_COMMAND, rig.node.od.limit_reasons);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
}

void test_a_refused_enabling_does_not_happen_later(void) {
    rig_start();
    rig_control(0x00, -1);
    rig.desired_inc = 6000;
    expect_refused(LIMIT_REASON_OUTSIDE_WINDOW);
    rig.desired_inc = 5000;
    rig_cycles(20);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
}

void test_enabling_needs_an_ordered_profile(void) {
    rig_write(0x2100, 2, 4, 7000); /* q_p below q_a */
    rig_start();
    rig_control(0x00, -1);
    expect_refused(LIMIT_REASON_CONFIGURATION);
}

void test_enabling_needs_an_injected_position(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    rig.desired_inc = 0;
    rig_control(0x00, -1);
    expect_refused(LIMIT_REASON_NO_POSITION);
}

void test_cyclic_synchronous_torque(void) {
    rig_start();
    rig_control(0x06, 10);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    rig_cycles(101);
    rig_command(999999, -1500, 4000); /* the position does not matter */
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(-1500, torque_mNm());
    rig_command(0, 3000, 1000);
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(1000, torque_mNm());
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_TORQUE_MAX, rig.node.od.limit_reasons);
}

void test_torque_slope_in_cyclic_synchronous_torque(void) {
    rig_start();
    rig_write(0x6087, 0, 4, 100000); /* 100 mN m in 1 ms */
    rig_control(0x06, 10);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    rig_cycles(101); /* 3 N m */
    for (int16_t torque = 2900; torque > -1500; torque -= 100) {
        rig_command(0, -1450, 4000);
        rig_sync();
        rig_step();
        TEST_ASSERT_EQUAL_INT16(torque, torque_mNm());
        TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_TORQUE_SLOPE, rig.node.od.limit_reasons);
    }
    rig_command(0, -1450, 4000);
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(-1450, torque_mNm());
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.limit_reasons);
}

void test_torque_slope_is_off_in_mode_fractal_impedance(void) {
    rig_write(0x6087, 0, 4, 1000);
    rig_run();
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.limit_reasons);
    rig.desired_inc = 4700;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(-4000, torque_mNm());
}

void test_torque_slope_starts_from_zero_after_a_stop(void) {
    rig_start();
    rig_write(0x6087, 0, 4, 10000);
    rig_control(0x06, 10);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycles(200);
    TEST_ASSERT_INT_WITHIN(10, 1990, torque_mNm());
    rig_control(0x00, 0); /* disable voltage: torque off at once */
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    rig_control(0x06, 0);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycles(11);
    TEST_ASSERT_EQUAL_INT16(100, torque_mNm());
}

void test_torque_slope_has_a_range(void) {
    rig_start();
    rig_write(0x6087, 0, 4, 999);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TOO_LOW, rig_abort());
    rig_write(0x6087, 0, 4, 1000);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(0, rig_abort());
}

void test_change_of_mode_starts_from_zero_again(void) {
    rig_run();
    rig_control(0x0F, 10);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT8(10, rig.node.od.modes_of_operation_display);
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm()); /* T_d = 3 N m, bound 0 */
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(50, torque_mNm()); /* 1 % of 5 N m */
}

void test_unsupported_mode_is_refused(void) {
    rig_start();
    rig_control(0x06, 8);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT8(0, rig.node.od.modes_of_operation_display);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_MODE, rig.node.od.limit_reasons);
    rig_control(0x06, 11);
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_rpdo_rejected);
}

void test_homing_on_the_present_position(void) {
    rig.config.referenced = false;
    motor_node_init(&rig.config, &rig.node);
    rig_write(0x607C, 0, 4, 100);
    rig_start();
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, statusword() & STATUSWORD_REFERENCED);
    rig_control(0x1F, 0);
    rig_cycle();
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_INT32(100, (int32_t)rig_u32(rig_sent(0x182)->data));
    TEST_ASSERT_TRUE((statusword() & STATUSWORD_REFERENCED) != 0U);
    TEST_ASSERT_TRUE((statusword() & 0x1000U) != 0U);
}

void test_halt_and_go_on(void) {
    rig_run();
    rig_control(0x10F, 0);
    rig.desired_inc = 5300;
    rig_cycles(100);
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    TEST_ASSERT_EQUAL_HEX16(0x27, statusword() & 0x6FU);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_HALT, rig.node.od.limit_reasons);
    TEST_ASSERT_EQUAL_HEX16(0, statusword() & STATUSWORD_FOLLOWS);
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    rig_cycles(100);
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
}

void test_halt_without_ramp(void) {
    rig_write(0x605D, 0, 2, 0);
    rig_run();
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(4000, torque_mNm());
    rig_control(0x10F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    rig.input.position_inc = 4700;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
}

void test_going_on_needs_the_desired_angle_near_the_measured(void) {
    rig_run();
    rig_control(0x10F, 0);
    rig.desired_inc = 6000;
    rig_cycles(100);
    rig_control(0x0F, 0);
    rig_cycles(100);
    TEST_ASSERT_EQUAL_INT16(0, torque_mNm());
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_HALT | LIMIT_REASON_OUTSIDE_WINDOW,
                            rig.node.od.limit_reasons);
}

void test_stale_sdo_transfer_is_aborted(void) {
    rig_step();
    rig_read(0x1008, 0);
    rig_step();
    rig.input.elapsed_us = SDO_TIMEOUT_us;
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TIMEOUT, rig_abort());
}

void test_convergence_shows_in_the_statusword(void) {
    rig_run();
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, statusword() & STATUSWORD_CONVERGENCE);
    rig.input.position_inc = 4990; /* gives the direction: downward */
    rig_cycle();
    rig.input.position_inc = 5010;
    rig_cycle();
    TEST_ASSERT_TRUE((statusword() & STATUSWORD_CONVERGENCE) != 0U);
}

void test_reset_node_is_left_to_the_port(void) {
    rig_run();
    rig.desired_inc = 5300;
    rig_cycle();
    rig_nmt(129);
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.reset_requested);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_UINT(0, rig.output.frame_count);
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.reset_requested);
    motor_node_init(&rig.config, &rig.node);
    rig_step();
    TEST_ASSERT_FALSE(rig.output.reset_requested);
    TEST_ASSERT_EQUAL_HEX16(0x702, rig.output.frames[0].id);
}

void test_reset_communication_restores_that_area_only(void) {
    rig_write(0x1017, 0, 2, 10);
    rig_write(0x2100, 4, 2, 1234);
    rig_start();
    rig_nmt(130);
    rig_step();
    rig_step();
    TEST_ASSERT_EQUAL_HEX8(0, rig_sent(0x702)->data[0]);
    TEST_ASSERT_EQUAL_UINT16(100, rig.node.od.producer_heartbeat_time);
    TEST_ASSERT_EQUAL_UINT16(1234, rig.node.od.fic_torque_limit_mNm);
    TEST_ASSERT_EQUAL_HEX32(0x12345678, rig.node.od.identity_object_serial_number);
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, rig.node.nmt);
}

void test_stopped_node_is_silent(void) {
    rig_start();
    rig_nmt(2);
    rig_read(0x1000, 0);
    rig_step();
    rig_read(0x1000, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT(0, rig.output.frame_count);
}

static void expect_abort(uint32_t code, uint16_t index, uint8_t subindex, uint8_t size,
                         uint32_t value) {
    rig_write(index, subindex, size, value);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(code, rig_abort());
}

void test_rules_of_single_objects(void) {
    rig_step();
    expect_abort(SDO_ABORT_RANGE, 0x1003, 0, 1, 1);
    expect_abort(SDO_ABORT_NOT_STORED, 0x1010, 1, 4, 1);
    expect_abort(SDO_ABORT_NO_RESOURCE, 0x1010, 1, 4, 0x65766173);
    expect_abort(SDO_ABORT_NOT_STORED, 0x1011, 1, 4, 1);
    expect_abort(0, 0x1011, 1, 4, 0x64616F6C);
    TEST_ASSERT_EQUAL_UINT32(1,
                             rig.node.od.restore_default_parameters_restore_all_default_parameters);
    expect_abort(0, 0x1016, 1, 4, 127U << 16 | 100U);
    expect_abort(SDO_ABORT_INCOMPATIBLE, 0x1016, 2, 4, 127U << 16 | 100U);
    expect_abort(0, 0x1016, 1, 4, 127U << 16 | 200U);
    expect_abort(SDO_ABORT_RANGE, 0x1019, 0, 1, 1);
    expect_abort(0, 0x1019, 0, 1, 240);
    expect_abort(0, 0x1006, 0, 4, 1000);
    expect_abort(SDO_ABORT_DEVICE_STATE, 0x1019, 0, 1, 0);
    expect_abort(SDO_ABORT_RANGE, 0x1028, 1, 4, 0x080);
    expect_abort(SDO_ABORT_RANGE, 0x1028, 1, 4, 0x100);
    expect_abort(0, 0x1028, 1, 4, 0x081);
    expect_abort(SDO_ABORT_RANGE, 0x605A, 0, 2, 3);
    expect_abort(0, 0x605A, 0, 2, 6);
    expect_abort(SDO_ABORT_RANGE, 0x6060, 0, 1, 8);
    expect_abort(0, 0x6060, 0, 1, 0xFF);
    TEST_ASSERT_EQUAL_INT8(-1, rig.node.od.modes_of_operation_display);
    expect_abort(0, 0x6060, 0, 1, 0);
    TEST_ASSERT_EQUAL_INT8(-1, rig.node.od.modes_of_operation_display);
    expect_abort(0, 0x607D, 1, 4, 100);
    expect_abort(SDO_ABORT_RANGE, 0x607D, 2, 4, 99);
}

void test_history_by_sdo(void) {
    rig_step();
    rig_read(0x1003, 1);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_DATA, rig_abort());
    const uint8_t nothing[3] = {0};
    rig_nmt(1);
    rig_send(0x202, 3, nothing); /* RPDO1, too short */
    rig_step();
    rig_read(0x1003, 1);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(0x00018210, rig_u32(&rig_sent(0x582)->data[4]));
    rig_write(0x1003, 0, 1, 0);
    rig_step();
    rig_read(0x1003, 1);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_DATA, rig_abort());
}

void test_configuration_is_closed_while_the_output_is_on(void) {
    rig_run();
    const struct {
        uint16_t index;
        uint8_t subindex;
        uint8_t size;
        uint32_t value;
    } writes[] = {{0x2100, 1, 4, 7000}, {0x2F00, 0, 1, 1}, {0x2F01, 0, 1, 1}, {0x608F, 1, 4, 4096},
                  {0x607A, 0, 4, 1},    {0x6071, 0, 2, 1}, {0x6072, 0, 2, 1}};
    for (size_t i = 0; i < sizeof writes / sizeof writes[0]; i++) {
        rig_write(writes[i].index, writes[i].subindex, writes[i].size, writes[i].value);
        rig_cycle();
        TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_DEVICE_STATE, rig_abort());
    }
}

void test_verify_configuration_is_cleared_by_a_change(void) {
    rig_step();
    expect_abort(0, 0x1020, 1, 4, 77);
    expect_abort(0, 0x6060, 0, 1, 10);
    TEST_ASSERT_EQUAL_UINT32(77, rig.node.od.verify_configuration_configuration_date);
    expect_abort(0, 0x1017, 0, 2, 50);
    TEST_ASSERT_EQUAL_UINT32(0, rig.node.od.verify_configuration_configuration_date);
}

void test_controlword_by_sdo(void) {
    rig_step();
    expect_abort(0, 0x6040, 0, 2, 0x06);
    TEST_ASSERT_EQUAL_HEX16(0x21, rig.node.od.statusword & 0x6FU);
}

void test_frames_beyond_what_a_step_sends_come_later(void) {
    rig_step();
    for (int i = 0; i < 20; i++) {
        rig_read(0x1000, 0);
    }
    size_t sent = 0;
    rig_step();
    TEST_ASSERT_EQUAL_UINT(MOTOR_NODE_TX_MAX, rig.output.frame_count);
    for (int i = 0; i < 3; i++) {
        sent += rig.output.frame_count;
        rig_step();
    }
    TEST_ASSERT_EQUAL_UINT(20, sent);
}

void test_reply_to_sync_overtakes_the_queue(void) {
    rig_start();
    for (int i = 0; i < 20; i++) {
        rig_read(0x1000, 0);
    }
    rig_cycle();
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x182, rig.output.frames[0].id);
}

void test_more_frames_than_a_step_reads_are_counted(void) {
    rig_step();
    for (int i = 0; i < 40; i++) {
        rig_nmt(1);
    }
    rig_step();
    TEST_ASSERT_EQUAL_UINT16(40 - MOTOR_NODE_RX_MAX, rig.node.od.counters_frames_not_read);
}

void test_frames_that_find_the_queue_full_are_counted(void) {
    rig_step();
    for (int step = 0; step < 3; step++) {
        for (uint32_t i = 0; i < MOTOR_NODE_RX_MAX; i++) {
            rig_read(0x1000, 0);
        }
        rig_step();
    }
    TEST_ASSERT_EQUAL_UINT16(3 * MOTOR_NODE_RX_MAX - 2 * MOTOR_NODE_TX_MAX - FRAME_QUEUE_SIZE,
                             rig.node.od.counters_frames_not_sent);
}

void test_late_command_is_dropped_by_the_synchronous_window(void) {
    rig_write(0x1007, 0, 4, 500);
    rig_start();
    TEST_ASSERT_EQUAL_UINT16(2, rig.node.od.counters_rpdo_rejected); /* 1 ms after SYNC */
    rig_sync();
    rig_command(5000, 0, 0); /* right behind SYNC */
    rig_step();
    TEST_ASSERT_EQUAL_UINT16(2, rig.node.od.counters_rpdo_rejected);
}

void test_which_identifiers_are_accepted(void) {
    for (uint16_t id = 0; id < 0x800; id++) {
        const bool heartbeat = id > 0x700 && id < 0x780;
        const bool sync_or_emergency = id >= 0x080 && id < 0x100;
        const bool own = id == 0x202 || id == 0x302 || id == 0x502 || id == 0x602;
        const bool of_a_double = id == 0x182 || id == 0x282 || id == 0x582;
        const bool expected =
            id == 0x000 || sync_or_emergency || own || of_a_double || heartbeat || id == 0x7E5;
        TEST_ASSERT_EQUAL_INT(expected, motor_node_accepts(NODE_ID, id));
        TEST_ASSERT_EQUAL_INT(id == 0x7E5, motor_node_accepts(LSS_UNCONFIGURED, id));
    }
}

void test_two_runs_are_the_same(void) {
    static motor_node_t first;
    rig_run();
    first = rig.node;
    rig_init();
    rig_run();
    TEST_ASSERT_EQUAL_MEMORY(&first.od, &rig.node.od, sizeof first.od);
    TEST_ASSERT_TRUE(first.controller.fic.f_max_Nm == rig.node.controller.fic.f_max_Nm);
}
