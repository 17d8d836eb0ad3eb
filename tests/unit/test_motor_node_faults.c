/* What a node does when things go wrong: one test per row of the table in docs/protocol.md. */
#include "unity.h"

#include "node_rig.h"

void setUp(void) {
    rig_init();
}
void tearDown(void) {}

/* The output bound goes to zero in 100 ms around the measured angle, then the fault is latched. */
static void expect_ramp_to_fault(uint16_t code) {
    TEST_ASSERT_EQUAL_HEX16(code, rig_emergency());
    TEST_ASSERT_EQUAL_HEX16(code, rig.node.od.error_code);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm); /* held where it is */
    rig.input.position_inc -= 300;
    for (int i = 2; i <= 100; i++) {
        TEST_ASSERT_TRUE(rig.output.output_enabled);
        rig_step();
        TEST_ASSERT_TRUE(rig.output.torque_mNm <= 50 * (100 - i)); /* TA = 5 N m */
        TEST_ASSERT_TRUE(i > 98 || rig.output.torque_mNm > 0);
    }
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    TEST_ASSERT_EQUAL_HEX16(0x28, rig.node.od.statusword & 0x6FU);
}

static void expect_torque_off(uint16_t code) {
    TEST_ASSERT_EQUAL_HEX16(code, rig_emergency());
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
}

/* --- command deadline, 8250h */

void test_command_deadline(void) {
    rig_run();
    for (int i = 1; i < 5; i++) {
        rig_sync();
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    }
    rig_sync();
    rig_step();
    expect_ramp_to_fault(0x8250);
}

void test_nothing_but_a_command_at_a_sync_feeds_the_deadline(void) {
    rig_run();
    for (int i = 1; i <= 5; i++) {
        rig_command(5000, 3000, 4000);
        rig_control(0x0F, 0);
        rig_read(0x6041, 0);
        rig_step();
    }
    expect_ramp_to_fault(0x8250);
}

void test_command_out_of_range_does_not_feed_the_deadline(void) {
    rig_run();
    for (int i = 1; i <= 5; i++) {
        rig_command(5000, 3000, 40000);
        rig_sync();
        rig_step();
    }
    TEST_ASSERT_EQUAL_UINT16(5, rig.node.od.counters_rpdo_rejected);
    expect_ramp_to_fault(0x8250);
}

void test_deadline_can_be_set_and_switched_off(void) {
    rig_write(0x1400, 5, 2, 20);
    rig_run();
    for (int i = 1; i < 20; i++) {
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    }
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8250, rig_emergency());
    rig_init();
    rig_write(0x1400, 5, 2, 0);
    rig_run();
    for (int i = 0; i < 1000; i++) {
        rig_step();
    }
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

/* --- missed SYNC, 8700h */

static void start_with_sync_supervision(void) {
    rig_write(0x1019, 0, 1, 240);
    rig_write(0x1006, 0, 4, 1000);
    rig_write(0x1400, 5, 2, 0);
    rig.sync_counter = 1;
    rig_run();
}

void test_missed_syncs(void) {
    start_with_sync_supervision();
    for (int i = 0; i < 4; i++) {
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    }
    TEST_ASSERT_EQUAL_UINT16(3, rig.node.od.counters_missed_sync);
    rig_step();
    expect_ramp_to_fault(0x8700);
}

void test_allowed_missed_syncs_are_counted_only(void) {
    start_with_sync_supervision();
    for (int i = 0; i < 3; i++) {
        rig_step();
    }
    rig.sync_counter = (uint8_t)(rig.sync_counter + 3U);
    rig_cycles(20);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_UINT16(3, rig.node.od.counters_missed_sync);
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_sync_counter_jumps);
    TEST_ASSERT_EQUAL_HEX8(0, rig.node.od.error_register);
}

void test_missed_syncs_at_the_return_of_sync(void) {
    start_with_sync_supervision();
    for (int i = 0; i < 4; i++) {
        rig_step();
    }
    rig_cycle(); /* 5 ms after the last one */
    TEST_ASSERT_EQUAL_HEX16(0x8700, rig_emergency());
}

void test_any_number_of_missed_syncs_when_so_set(void) {
    rig_write(0x2102, 0, 1, 255);
    start_with_sync_supervision();
    for (int i = 0; i < 600; i++) {
        rig_step();
    }
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_UINT16(599, rig.node.od.counters_missed_sync);
}

/* --- SYNC of wrong length, 8240h */

void test_sync_of_wrong_length(void) {
    rig_run();
    rig.sync_counter = 1;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8240, rig_emergency());
    TEST_ASSERT_NOT_NULL(rig_sent(0x182));
    for (int i = 0; i < 20; i++) {
        rig_cycle();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
        TEST_ASSERT_TRUE(rig.output.output_enabled);
    }
}

/* --- heartbeat and emergency of others, 8130h */

static void heartbeat_of_host(void) {
    const uint8_t state = 5;
    rig_send(0x77F, 1, &state);
}

void test_heartbeat_lost(void) {
    rig_write(0x1016, 1, 4, 127U << 16 | 50U);
    rig_run();
    heartbeat_of_host();
    rig_cycles(50);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT8(127, rig_sent(0x082)->data[3]);
    expect_ramp_to_fault(0x8130);
}

void test_heartbeat_lost_without_output_is_reported_only(void) {
    rig_write(0x1016, 1, 4, 127U << 16 | 50U);
    rig_start();
    heartbeat_of_host();
    rig_cycles(51);
    TEST_ASSERT_EQUAL_HEX16(0x8130, rig_emergency());
    TEST_ASSERT_EQUAL_INT(DRIVE_SWITCH_ON_DISABLED, rig.node.drive.state);
    TEST_ASSERT_EQUAL_INT(NMT_OPERATIONAL, rig.node.nmt); /* 1029h = 1 */
}

void test_error_behaviour_changes_the_state(void) {
    rig_write(0x1016, 1, 4, 127U << 16 | 50U);
    rig_write(0x1029, 1, 1, 0);
    rig_start();
    heartbeat_of_host();
    rig_cycles(51);
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, rig.node.nmt);
    rig_write(0x1029, 1, 1, 2);
    heartbeat_of_host();
    rig_step();
    for (int i = 0; i < 50; i++) {
        rig_step();
    }
    TEST_ASSERT_EQUAL_INT(NMT_STOPPED, rig.node.nmt);
}

void test_emergency_of_a_peer(void) {
    const uint8_t overspeed[8] = {0x00, 0x84, 0x21};
    const uint8_t gone[8] = {0};
    rig_write(0x1028, 1, 4, 0x081);
    rig_run();
    rig_send(0x083, 8, overspeed); /* not watched */
    rig_send(0x081, 8, gone);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    rig_send(0x081, 8, overspeed);
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT8(1, rig_sent(0x082)->data[3]);
    expect_ramp_to_fault(0x8130);
}

/* --- NMT leaves operational while enabled: 6007h */

void test_leaving_operational_is_a_lost_command(void) {
    rig_run();
    rig_nmt(128);
    rig_step();
    expect_ramp_to_fault(0x8250);
}

void test_stopped_while_enabled_ramps_down(void) {
    rig_run();
    rig_nmt(2);
    rig_step();
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
    for (int i = 0; i < 99; i++) {
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency()); /* none in stopped */
    }
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    rig_nmt(128);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8250, rig_emergency());
}

void test_abort_connection_option_codes(void) {
    const drive_state_t states[] = {DRIVE_OPERATION_ENABLED, DRIVE_FAULT_REACTION_ACTIVE,
                                    DRIVE_SWITCH_ON_DISABLED, DRIVE_QUICK_STOP_ACTIVE};
    for (uint32_t option = 0; option <= 3U; option++) {
        rig_init();
        rig_write(0x6007, 0, 2, option);
        rig_write(0x1400, 5, 2, 100);
        rig_run();
        rig_nmt(128);
        rig_step();
        TEST_ASSERT_EQUAL_INT(states[option], rig.node.drive.state);
    }
}

void test_reset_communication_while_enabled(void) {
    rig_run();
    rig_nmt(130);
    rig_step();
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
    TEST_ASSERT_EQUAL_HEX8(0x11, rig.node.od.error_register);
}

/* --- PDOs of wrong length, 8210h and 8220h */

void test_short_pdo_is_not_processed(void) {
    const uint8_t data[8] = {0x0F, 0x00};
    rig_start();
    rig_send(0x302, 2, data);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8210, rig_emergency());
    TEST_ASSERT_EQUAL_UINT8(2, rig_sent(0x082)->data[3]);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.controlword);
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_rpdo_rejected);
}

void test_long_pdo_is_processed_by_its_first_bytes(void) {
    const uint8_t data[8] = {0x06, 0x00, 0xFF, 0x55, 0x55, 0x55, 0x55, 0x55};
    rig_start();
    rig_send(0x302, 8, data);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8220, rig_emergency());
    TEST_ASSERT_EQUAL_HEX16(0x21, rig.node.od.statusword & 0x6FU);
    TEST_ASSERT_EQUAL_INT8(-1, rig.node.od.modes_of_operation_display);
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_rpdo_too_long);
}

void test_short_injected_sensors(void) {
    const uint8_t data[8] = {0};
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    rig_send(0x502, 7, data);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8210, rig_emergency());
    TEST_ASSERT_FALSE(rig.node.position_known);
}

/* --- own node-id heard, 8100h */

void test_own_node_id_heard(void) {
    const uint16_t ids[] = {0x082, 0x182, 0x282, 0x582, 0x702};
    const uint8_t data[8] = {5};
    for (size_t i = 0; i < sizeof ids / sizeof ids[0]; i++) {
        rig_init();
        rig_run();
        rig_send(ids[i], 8, data);
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0x8100, rig_emergency());
        TEST_ASSERT_EQUAL_INT(NMT_STOPPED, rig.node.nmt);
        TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
        for (int step = 0; step < 99; step++) {
            rig_step();
        }
        TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
        TEST_ASSERT_FALSE(rig.output.output_enabled);
    }
}

void test_identifiers_of_others_are_no_conflict(void) {
    const uint16_t ids[] = {0x081, 0x181, 0x281, 0x581, 0x701, 0x7E5, 0x7E4, 0x100, 0x782, 0x482};
    const uint8_t data[8] = {0};
    rig_run();
    for (size_t i = 0; i < sizeof ids / sizeof ids[0]; i++) {
        rig_send(ids[i], 8, data);
    }
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
}

/* --- position limits 8612h, overspeed 8400h, following error 8611h */

void test_position_limits(void) {
    rig_write(0x607D, 2, 4, 5050);
    rig_run();
    rig.desired_inc = 5300;
    rig.input.position_inc = 5050;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm); /* nothing outward */
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_POSITION_LIMIT, rig.node.od.limit_reasons);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    rig.input.position_inc = 5051;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8612, rig_emergency());
    TEST_ASSERT_TRUE((rig.node.od.statusword & STATUSWORD_WARNING) != 0U);
    rig.desired_inc = 4800;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());           /* once */
    TEST_ASSERT_EQUAL_INT16(-4000, rig.output.torque_mNm); /* back inside */
    rig.input.position_inc = 5040;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & STATUSWORD_WARNING);
    rig.input.position_inc = 5060;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8612, rig_emergency());
}

void test_lower_position_limit(void) {
    rig_write(0x607D, 1, 4, 4990);
    rig_run();
    rig.desired_inc = 4700;
    rig.input.position_inc = 4989;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8612, rig_emergency());
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
}

void test_overspeed(void) {
    rig_write(0x6080, 0, 4, 60); /* 65.536 increments each ms */
    rig_run();
    for (int i = 0; i < 100; i++) {
        rig.input.position_inc += 64;
        rig.desired_inc = rig.input.position_inc;
        rig_cycle();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    }
    int cycles = 0;
    while (rig_emergency() == 0U && cycles < 30) {
        rig.input.position_inc += 68;
        rig.desired_inc = rig.input.position_inc;
        rig_cycle();
        cycles++;
    }
    TEST_ASSERT_TRUE(cycles <= 20);
    rig.node.od.max_motor_speed = 600; /* else the step to come is a jump, and is derated */
    rig.node.speed_ppm = 0;
    expect_ramp_to_fault(0x8400);
}

void test_following_error(void) {
    rig_write(0x6066, 0, 2, 10);
    rig_run();
    rig.desired_inc = 5600;
    rig_cycles(5);
    rig.desired_inc = 5000;
    rig_cycle();
    rig.desired_inc = 5600;
    rig_cycles(9);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8611, rig_emergency());
}

/* --- encoder implausible, 7305h */

static void run_injected(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    for (int i = 0; i < 104; i++) {
        rig_inject(5000, (uint8_t)i, 0);
        if (i == 1) {
            rig_control(0x06, -1);
        }
        if (i == 2) {
            rig_control(0x0F, 0);
        }
        rig_cycle();
    }
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_encoder_jump(void) {
    rig_run();
    rig.input.position_inc += 2 * 655 + 2; /* twice 600 rpm */
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig.input.position_inc -= 2 * 655 + 3;
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT8(1, rig_sent(0x082)->data[3]);
    expect_torque_off(0x7305);
}

void test_late_sensor_frames_are_no_jump(void) {
    rig_run();
    rig_cycles(3);
    rig.input.position_inc += 4 * 2 * 655;
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_encoder_stuck_under_torque(void) {
    rig_run();
    rig.desired_inc = 5300; /* 4 N m of TA = 5 N m */
    rig_cycles(500);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig.input.position_inc++; /* it does move */
    rig_cycles(500);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT8(3, rig_sent(0x082)->data[3]);
    expect_torque_off(0x7305);
}

void test_a_blocked_joint_is_allowed_below_the_torque_or_when_switched_off(void) {
    rig_write(0x2103, 1, 1, 81);
    rig_run();
    rig.desired_inc = 5300;
    rig_cycles(2000);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig_init();
    rig_write(0x2103, 1, 1, 0);
    rig_run();
    rig.desired_inc = 5300;
    rig_cycles(2000);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

static void home_on_index(void) {
    rig_write(0x6098, 0, 1, 34);
    rig_start();
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    rig_control(0x1F, 0);
    rig_cycle();
    rig.input.index_seen = true;
    rig.input.index_position_inc = 5000;
    rig_cycle();
    TEST_ASSERT_TRUE(rig.node.referenced);
}

void test_index_pulse_out_of_its_place(void) {
    home_on_index();
    const int32_t places[] = {5000 + 65536, 5000 - 65536, 5000 + 1024, 5000 - 1024,
                              5000 + 3 * 65536 - 1024};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        rig.input.index_position_inc = places[i];
        rig_cycle();
        TEST_ASSERT_TRUE(rig.output.output_enabled);
    }
    rig.input.index_position_inc = 5000 - 65536 - 1025;
    rig_cycle();
    TEST_ASSERT_EQUAL_UINT8(2, rig_sent(0x082)->data[3]);
    expect_torque_off(0x7305);
}

void test_index_supervision_can_be_switched_off(void) {
    rig_write(0x2103, 3, 4, 0);
    home_on_index();
    rig.input.index_position_inc = 7000;
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_encoder_fault(void) {
    run_injected();
    rig_inject(5000, 104, 0x02);
    rig_cycle();
    expect_torque_off(0x7305);
}

void test_injected_sensors_gone_silent(void) {
    run_injected();
    rig_cycles(4);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig_cycle();
    expect_torque_off(0x7305);
}

/* --- over-current 2310h, over-temperature 4310h, and the derating before them */

void test_temperature_derates_then_faults(void) {
    rig_run();
    rig.desired_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(4000, rig.output.torque_mNm);
    rig.input.temperature_dC = 1100;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(2500, rig.output.torque_mNm); /* half of TA */
    TEST_ASSERT_TRUE((rig.node.od.limit_reasons & LIMIT_REASON_TEMPERATURE) != 0U);
    TEST_ASSERT_TRUE((rig.node.od.statusword & STATUSWORD_INTERNAL_LIMIT) != 0U);
    rig.input.temperature_dC = 1200;
    rig.input.position_inc = 5300;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x4310, rig_emergency());
    TEST_ASSERT_EQUAL_HEX8(0x09, rig.node.od.error_register);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
}

void test_current_derates(void) {
    rig_run();
    rig.desired_inc = 5300;
    rig.input.current_mA = 1225; /* 1.5 times the square of the rated one, after a while */
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(4000, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_INT16(1225, rig.node.od.current_actual_value);
    for (int i = 0; i < 9000; i++) {
        rig.input.position_inc = 5000 + i % 2;
        rig_cycle();
    }
    TEST_ASSERT_INT_WITHIN(30, 2500, rig.output.torque_mNm);
    TEST_ASSERT_TRUE((rig.node.od.limit_reasons & LIMIT_REASON_CURRENT) != 0U);
}

void test_over_current(void) {
    rig_run();
    rig.input.current_mA = 20001;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX8(0x03, rig.node.od.error_register);
    expect_torque_off(0x2310);
}

void test_hot_or_overloaded_without_output_is_no_fault(void) {
    rig_start();
    rig.input.current_mA = UINT32_MAX;
    rig.input.temperature_dC = 2000;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    TEST_ASSERT_EQUAL_INT16(INT16_MAX, rig.node.od.current_actual_value);
}

void test_speed_derates_what_accelerates(void) {
    rig_write(0x6080, 0, 4, 60); /* 65.536 increments each ms */
    rig_run();
    int16_t accelerating = 0;
    for (int i = 0; i < 40; i++) { /* 95 % of it */
        rig.input.position_inc += i % 4 == 0 ? 61 : 62;
        rig.desired_inc = rig.input.position_inc + 300;
        rig_cycle();
    }
    accelerating = rig.output.torque_mNm;
    TEST_ASSERT_INT_WITHIN(300, 2650, accelerating);
    TEST_ASSERT_TRUE((rig.node.od.limit_reasons & LIMIT_REASON_SPEED) != 0U);
    rig.input.position_inc += 62;
    rig.desired_inc = rig.input.position_inc - 300;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT16(-4000, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.limit_reasons & LIMIT_REASON_SPEED);
}

/* --- bus-off, 8140h */

void test_bus_off(void) {
    rig_run();
    rig.input.bus_off = true;
    rig.input.position_inc += 100;
    for (int i = 0; i < 100; i++) {
        TEST_ASSERT_TRUE(rig.output.output_enabled);
        rig_step();
        TEST_ASSERT_EQUAL_UINT(0, rig.output.frame_count);
    }
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    rig.input.bus_off = false;
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x8140, rig_emergency());
    rig_cycles(10);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state); /* stays */
}

void test_bus_off_without_output_is_reported(void) {
    rig_start();
    rig.input.bus_off = true;
    rig_step();
    rig_step();
    rig.input.bus_off = false;
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8140, rig_emergency());
    TEST_ASSERT_EQUAL_INT(DRIVE_SWITCH_ON_DISABLED, rig.node.drive.state);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.pre_defined_error_field_number_of_errors);
}

/* --- watchdog or supervisor reset 6010h, internal oscillator */

void test_supervisor_reset_boots_disabled_and_says_so(void) {
    rig.config.supervisor_reset = true;
    motor_node_init(&rig.config, &rig.node);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x702, rig.output.frames[0].id);
    TEST_ASSERT_EQUAL_HEX16(0x6010, rig_emergency());
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT(DRIVE_SWITCH_ON_DISABLED, rig.node.drive.state);
}

void test_enabling_on_the_internal_oscillator_is_refused(void) {
    rig.config.clock_fallback = true;
    motor_node_init(&rig.config, &rig.node);
    rig_start();
    rig_enable();
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_CLOCK, rig.node.od.limit_reasons);
}

void test_the_internal_oscillator_does_not_matter_to_a_stepped_node(void) {
    rig.config.clock_fallback = true;
    motor_node_init(&rig.config, &rig.node);
    rig_write(0x2F01, 0, 1, 1);
    rig_start();
    rig_enable();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

/* --- a fault is latched until fault reset */

void test_fault_is_latched_until_reset(void) {
    rig_run();
    for (int i = 0; i < 200; i++) {
        rig_step();
    }
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    rig_cycles(50);
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    TEST_ASSERT_EQUAL_HEX8(0x11, rig.node.od.error_register);
    rig_control(0x80, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT(DRIVE_SWITCH_ON_DISABLED, rig.node.drive.state);
    TEST_ASSERT_NOT_NULL(rig_sent(0x082));
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    TEST_ASSERT_EQUAL_HEX8(0, rig.node.od.error_register);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.error_code);
    rig_enable();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
}

void test_only_the_first_fault_counts(void) {
    const uint8_t overspeed[8] = {0x00, 0x84, 0x21};
    rig_write(0x1028, 1, 4, 0x081);
    rig_run();
    rig_send(0x081, 8, overspeed);
    rig_cycle();
    rig_send(0x081, 8, overspeed);
    for (int i = 0; i < 200; i++) {
        rig_step();
    }
    TEST_ASSERT_EQUAL_HEX16(0x8130, rig.node.od.error_code);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.pre_defined_error_field_number_of_errors);
}

void test_fault_reaction_without_ramp(void) {
    rig_write(0x605E, 0, 2, 0);
    rig_run();
    for (int i = 0; i < 5; i++) {
        rig_step();
    }
    expect_torque_off(0x8250);
}

void test_commands_during_the_ramp_do_not_move_the_held_angle(void) {
    rig_run();
    rig_control(0x02, 0);
    rig.desired_inc = 5400;
    rig_cycles(3);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
}
