/* The motor node where two things meet: the wrong state, another node's frame, the second time. */
#include "unity.h"

#include "node_rig.h"

void setUp(void) {
    rig_init();
}
void tearDown(void) {}

static void expect_abort(uint32_t code, uint16_t index, uint8_t subindex, uint8_t size,
                         uint32_t value) {
    rig_write(index, subindex, size, value);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(code, rig_abort());
}

/* Operation enabled in mode -1 on injected sensors. */
static void run_injected(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    for (int i = 0; i < 100; i++) {
        rig_inject(5000, (uint8_t)i, 0);
        rig_control((const uint16_t[]){0x00, 0x06, 0x0F}[i < 2 ? i : 2], -1);
        rig_cycle();
    }
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

/* --- frames that are not for this node, or not now */

void test_pdos_and_sdos_of_other_nodes_change_nothing(void) {
    const uint8_t data[8] = {0x06, 0x00, 0xFF};
    rig_write(0x2F00, 0, 1, 1);
    rig_start();
    const object_dictionary_t before = rig.node.od;
    rig_send(0x203, 8, data);
    rig_send(0x303, 3, data);
    rig_send(0x503, 8, data);
    rig_send(0x603, 8, data);
    rig_step();
    TEST_ASSERT_EQUAL_MEMORY(&before, &rig.node.od, sizeof before);
    TEST_ASSERT_FALSE(rig.node.command_waiting);
    TEST_ASSERT_NULL(rig_sent(0x582));
}

void test_pdos_before_the_start_change_nothing(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_step();
    rig_step();
    const object_dictionary_t before = rig.node.od;
    rig_command(77, 1, 2);
    rig_control(0x06, -1);
    rig_inject(77, 1, 0);
    rig_step();
    TEST_ASSERT_EQUAL_MEMORY(&before, &rig.node.od, sizeof before);
    TEST_ASSERT_FALSE(rig.node.command_waiting);
}

void test_abort_from_the_client_is_not_answered(void) {
    const uint8_t data[8] = {0x80, 0x00, 0x10};
    rig_step();
    rig_send(0x602, 8, data);
    rig_step();
    TEST_ASSERT_NULL(rig_sent(0x582));
}

void test_own_node_id_heard_twice_is_one_fault(void) {
    const uint8_t data[8] = {0};
    rig_run();
    rig_send(0x182, 8, data);
    rig_send(0x182, 8, data);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8100, rig_emergency());
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.pre_defined_error_field_number_of_errors);
}

void test_own_node_id_is_told_before_the_node_falls_silent(void) {
    const uint8_t data[8] = {0};
    rig_write(0x1015, 0, 2, 50); /* 5 ms between emergencies */
    rig_start();
    rig_send(0x202, 3, data); /* RPDO1, too short: 8210h */
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8210, rig_emergency());
    rig_send(0x182, 8, data);
    for (int i = 1; i < 5; i++) {
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
        TEST_ASSERT_EQUAL_INT(NMT_OPERATIONAL, rig.node.nmt);
    }
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8100, rig_emergency());
    TEST_ASSERT_EQUAL_INT(NMT_STOPPED, rig.node.nmt);
}

void test_own_node_id_heard_by_a_stopped_node_in_fault_changes_nothing(void) {
    const uint8_t data[8] = {0};
    rig_run();
    for (int i = 0; i < 200; i++) {
        rig_step(); /* deadline 8250h */
    }
    rig_nmt(2);
    rig_step();
    rig_send(0x182, 8, data);
    rig_step();
    TEST_ASSERT_EQUAL_INT(NMT_STOPPED, rig.node.nmt);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    TEST_ASSERT_EQUAL_HEX16(0x8250, rig.node.od.error_code);
}

/* --- emergencies and heartbeats of others */

void test_emergency_too_short_for_a_code_is_none(void) {
    const uint8_t data[1] = {0x84};
    rig_write(0x1028, 1, 4, 0x081);
    rig_run();
    rig_send(0x081, 1, data);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT(DRIVE_OPERATION_ENABLED, rig.node.drive.state);
}

void test_emergency_of_a_peer_matters_only_with_output(void) {
    const uint8_t overspeed[8] = {0x00, 0x84, 0x21};
    rig_write(0x1028, 1, 4, 0x081);
    rig_start();
    rig_send(0x081, 8, overspeed);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    TEST_ASSERT_EQUAL_INT(DRIVE_SWITCH_ON_DISABLED, rig.node.drive.state);
}

void test_stopped_node_does_not_hear_emergencies(void) {
    const uint8_t overspeed[8] = {0x00, 0x84, 0x21};
    rig_write(0x1028, 1, 4, 0x081);
    rig_write(0x6007, 0, 2, 0); /* goes on with its output when it is stopped */
    rig_run();
    rig_nmt(2);
    rig_send(0x081, 8, overspeed);
    rig_step();
    TEST_ASSERT_EQUAL_INT(DRIVE_OPERATION_ENABLED, rig.node.drive.state);
    TEST_ASSERT_EQUAL_UINT8(0, rig.node.od.error_register);
}

void test_lost_heartbeat_leaves_a_pre_operational_node_as_it_is(void) {
    const uint8_t operational = 5;
    rig_write(0x1016, 1, 4, 127U << 16 | 50U);
    rig_write(0x1029, 1, 1, 0); /* operational would become pre-operational */
    rig_step();
    rig_send(0x77F, 1, &operational);
    for (int i = 0; i < 51; i++) {
        rig_step();
    }
    TEST_ASSERT_EQUAL_HEX16(0x8130, rig_emergency());
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, rig.node.nmt);
}

void test_only_the_same_node_is_watched_already(void) {
    rig_step();
    expect_abort(0, 0x1016, 1, 4, 127U << 16 | 100U);
    expect_abort(0, 0x1016, 2, 4, 1U << 16 | 100U);
    expect_abort(0, 0x1016, 3, 4, 127U << 16); /* a time of 0 watches nobody */
    expect_abort(SDO_ABORT_INCOMPATIBLE, 0x1016, 3, 4, 1U << 16 | 100U);
}

/* --- position at the ends of its range */

void test_position_saturates(void) {
    rig_start();
    rig.node.offset_inc = 10;
    rig.input.position_inc = INT32_MAX - 5;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, rig.node.od.position_actual_value);
    rig.node.offset_inc = -10;
    rig.input.position_inc = INT32_MIN + 5;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, rig.node.od.position_actual_value);
}

void test_position_limits_without_output_are_not_reported(void) {
    rig_write(0x607D, 2, 4, 4000); /* the position is 5000 */
    rig_start();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & STATUSWORD_WARNING);
}

void test_speed_far_beyond_the_highest_saturates(void) {
    rig_write(0x6080, 0, 4, 1);
    rig_start();
    rig_cycles(10);
    rig.input.position_inc += 1000000;
    rig_cycles(10);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, rig.node.speed_ppm);
    TEST_ASSERT_EQUAL_INT8(1, rig.node.moving);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.error_code); /* no output, no fault */
}

void test_current_in_thousandths_of_the_rated_one(void) {
    rig_write(0x6075, 0, 4, 2000);
    rig.input.current_mA = 500;
    rig_step();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(250, rig.node.od.current_actual_value);
    rig_write(0x6075, 0, 4, 0); /* none is known: counts as 1 mA */
    rig_step();
    TEST_ASSERT_EQUAL_INT16(INT16_MAX, rig.node.od.current_actual_value);
    rig.input.current_mA = 7;
    rig_step();
    TEST_ASSERT_EQUAL_INT16(7000, rig.node.od.current_actual_value);
}

/* --- refusals, halt, torque limit */

void test_enabling_needs_an_ordered_second_slope(void) {
    rig_write(0x2100, 3, 4, 8999); /* q_b < q_p */
    rig_start();
    rig_enable();
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_CONFIGURATION, rig.node.od.limit_reasons);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
}

void test_mode_that_is_refused_with_output_on_is_not_taken(void) {
    rig.config.referenced = false;
    motor_node_init(&rig.config, &rig.node);
    rig_start();
    rig_control(0x06, 10);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    rig_control(0x0F, -1);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT8(10, rig.node.od.modes_of_operation_display);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_NOT_REFERENCED,
                            rig.node.od.limit_reasons & LIMIT_REASON_NOT_REFERENCED);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_halt_again_holds_the_same_angle(void) {
    rig_write(0x6065, 0, 4, 100000);
    rig_run();
    rig_control(0x10F, 0);
    rig_cycle();
    rig.input.position_inc += 300;
    rig_control(0x10F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(5000, rig.node.controller.now.position_inc);
    TEST_ASSERT_TRUE(rig.output.torque_mNm < 0); /* pulled back, not held at the new angle */
}

void test_torque_limit_is_a_reason(void) {
    rig_run();
    rig_command(5300, 3000, 8000); /* beyond q_b: T_max = 8 N m, but TA = 5 N m */
    rig_sync();
    rig_step();
    TEST_ASSERT_EQUAL_INT16(5000, rig.output.torque_mNm);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_TORQUE_LIMIT, rig.node.od.limit_reasons);
}

/* --- faults on faults, deadlines that are off */

void test_torque_off_cuts_a_fault_ramp_short(void) {
    run_injected();
    rig_nmt(128);
    rig_step(); /* a lost command: ramp */
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
    for (int i = 0; i < 6; i++) { /* no position any more: 7305h is not ramped */
        rig_step();
    }
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    TEST_ASSERT_EQUAL_HEX16(0x7305, rig.node.od.error_code);
    TEST_ASSERT_FALSE(rig.output.output_enabled);
}

void test_faults_in_the_state_fault_change_nothing(void) {
    const uint8_t data[8] = {0};
    rig_run();
    for (int i = 0; i < 200; i++) {
        rig_step(); /* deadline 8250h */
    }
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
    rig_send(0x182, 8, data);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x8250, rig.node.od.error_code);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT, rig.node.drive.state);
}

void test_without_a_deadline_silent_sensors_are_no_fault(void) {
    rig_write(0x1400, 5, 2, 0);
    run_injected();
    rig_cycles(50);
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.error_code);
}

/* --- values that only the node can judge */

void test_set_values_do_not_touch_verify_configuration(void) {
    const struct {
        uint16_t index;
        uint8_t subindex;
        uint8_t size;
        uint32_t value;
    } writes[] = {{0x1003, 0, 1, 0}, {0x6040, 0, 2, 0},         {0x607A, 0, 4, 1},
                  {0x6071, 0, 2, 1}, {0x6072, 0, 2, 1},         {0x1020, 2, 4, 3},
                  {0x2F02, 1, 4, 5}, {0x1011, 1, 4, 0x64616F6C}};
    rig_step();
    expect_abort(0, 0x1020, 1, 4, 77);
    for (size_t i = 0; i < sizeof writes / sizeof writes[0]; i++) {
        expect_abort(0, writes[i].index, writes[i].subindex, writes[i].size, writes[i].value);
        TEST_ASSERT_EQUAL_UINT32(77, rig.node.od.verify_configuration_configuration_date);
    }
}

void test_values_between_the_allowed_ones_are_refused(void) {
    rig_step();
    expect_abort(SDO_ABORT_RANGE, 0x605A, 0, 2, 3);
    expect_abort(SDO_ABORT_RANGE, 0x605A, 0, 2, 4);
    expect_abort(0, 0x605A, 0, 2, 5);
    expect_abort(SDO_ABORT_RANGE, 0x1028, 1, 4, 0x080);
    expect_abort(0, 0x1028, 1, 4, 0x80000000U); /* off */
    expect_abort(0, 0x607D, 1, 4, 100);
    expect_abort(0, 0x607D, 2, 4, 100);
    expect_abort(SDO_ABORT_RANGE, 0x607D, 1, 4, 101);
}
