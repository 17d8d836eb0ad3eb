/* Mode 6 of the whole node: the search for the index pulse on an encoder without a reference. */
#include "unity.h"

#include "node_rig.h"

void setUp(void) {
    rig_init();
    rig.config.referenced = false;
    motor_node_init(&rig.config, &rig.node);
}
void tearDown(void) {}

static void start_homing(uint8_t method) {
    rig_write(0x6098, 0, 1, method);
    rig_write(0x607C, 0, 4, 100);
    rig_start();
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycles(105);
    TEST_ASSERT_EQUAL_HEX16(0x0400, rig.node.od.statusword & 0x3400U);
    rig_control(0x1F, 0);
    rig_cycle();
}

/* The joint follows the torque like a heavy damped mass: an increment a tick. */
static void follow(int ticks) {
    for (int i = 0; i < ticks; i++) {
        rig.input.position_inc += rig.output.torque_mNm > 0   ? 5
                                  : rig.output.torque_mNm < 0 ? -5
                                                              : 0;
        rig_cycle();
    }
}

static void expect_search(uint8_t method, int direction) {
    start_homing(method);
    follow(50);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & 0x3400U);
    TEST_ASSERT_TRUE((rig.input.position_inc - 5000) * direction > 100);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & STATUSWORD_REFERENCED);
    rig.input.index_seen = true;
    rig.input.index_position_inc = rig.input.position_inc - 3 * direction;
    rig_cycle();
    rig.input.index_seen = false;
    TEST_ASSERT_EQUAL_INT32(100 + 3 * direction, rig.node.od.position_actual_value);
    TEST_ASSERT_TRUE((rig.node.od.statusword & STATUSWORD_REFERENCED) != 0U);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm); /* held where it is */
    rig_cycles(20);
    TEST_ASSERT_EQUAL_HEX16(0x1400, rig.node.od.statusword & 0x3400U);
    rig.input.position_inc += 50 * direction;
    rig_cycle();
    TEST_ASSERT_TRUE(rig.output.torque_mNm * direction < -100);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
}

void test_index_pulse_in_positive_direction(void) {
    expect_search(34, 1);
}

void test_index_pulse_in_negative_direction(void) {
    expect_search(33, -1);
}

void test_homing_torque_is_limited(void) {
    rig_write(0x2104, 1, 2, 300);
    start_homing(34);
    for (int i = 0; i < 400; i++) {
        rig_cycle(); /* blocked */
        TEST_ASSERT_TRUE(rig.output.torque_mNm <= 300);
    }
    TEST_ASSERT_EQUAL_INT16(300, rig.output.torque_mNm);
}

void test_no_index_pulse_in_time_is_an_error(void) {
    rig_write(0x2104, 2, 2, 200);
    start_homing(34);
    rig_cycles(198);
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & 0x3400U);
    rig_cycles(1);
    TEST_ASSERT_EQUAL_HEX16(0x2400, rig.node.od.statusword & 0x3400U);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    TEST_ASSERT_FALSE(rig.node.referenced);
}

void test_taking_the_start_bit_back_interrupts(void) {
    start_homing(34);
    follow(30);
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x0400, rig.node.od.statusword & 0x3400U);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm);
    rig_control(0x1F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & 0x3400U);
}

void test_quick_stop_and_halt_interrupt(void) {
    start_homing(34);
    follow(30);
    rig_control(0x11F, 0);
    rig_cycles(2);
    TEST_ASSERT_EQUAL_HEX16(0x0400, rig.node.od.statusword & 0x3400U);
    TEST_ASSERT_FALSE(rig.node.referenced);
}

void test_a_search_forgets_the_reference_before(void) {
    rig.config.referenced = true;
    motor_node_init(&rig.config, &rig.node);
    rig_write(0x6098, 0, 1, 34);
    rig_start();
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0x1400, rig.node.od.statusword & 0x3400U);
    rig_control(0x1F, 0);
    rig_cycle();
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & STATUSWORD_REFERENCED);
}

void test_home_beyond_the_range_of_positions_fails(void) {
    rig_write(0x6098, 0, 1, 34);
    rig_start();
    rig_write(0x607C, 0, 4, 0x7FFFFFFF);
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycles(2);
    rig_control(0x1F, 0);
    rig_cycles(2);
    rig.input.index_seen = true;
    rig.input.index_position_inc = -100;
    rig_cycle();
    rig_cycles(20);
    TEST_ASSERT_EQUAL_HEX16(0x2400, rig.node.od.statusword & 0x3400U);
    TEST_ASSERT_FALSE(rig.node.referenced);
}

static void expect_home_fails(int32_t encoder_inc, int32_t index_inc, uint32_t home_inc) {
    setUp();
    rig.input.position_inc = encoder_inc;
    rig_write(0x6098, 0, 1, 34);
    rig_start();
    rig_write(0x607C, 0, 4, home_inc);
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycles(2);
    rig_control(0x1F, 0);
    rig_cycles(2);
    rig.input.index_seen = true;
    rig.input.index_position_inc = index_inc;
    rig_cycle();
    TEST_ASSERT_EQUAL_INT(HOMING_FAILED, rig.node.homing.phase);
    TEST_ASSERT_FALSE(rig.node.referenced);
    TEST_ASSERT_EQUAL_INT32(encoder_inc, rig.node.od.position_actual_value);
}

static void expect_home_at_the_end(int32_t end_inc, int32_t step_inc) {
    setUp();
    rig.input.position_inc = -step_inc * 100;
    rig_write(0x6098, 0, 1, 37);
    rig_write(0x607C, 0, 4, (uint32_t)end_inc);
    rig_start();
    rig_control(0x06, 6);
    rig_cycle();
    rig_control(0x0F, 0);
    for (int i = 0; i < 15; i++) { /* the speed's interval has begun further inside the range */
        rig.input.position_inc += step_inc;
        rig_cycle();
    }
    rig_control(0x1F, 0);
    rig_cycle();
    TEST_ASSERT_TRUE(rig.node.referenced);
    TEST_ASSERT_EQUAL_INT32(end_inc, rig.node.od.position_actual_value);
    for (int i = 0; i < 30; i++) {
        rig_cycle();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency()); /* no overspeed out of a number that wrapped */
        TEST_ASSERT_EQUAL_INT32(end_inc, rig.node.od.position_actual_value);
    }
}

void test_home_at_an_end_of_the_range(void) {
    expect_home_at_the_end(INT32_MIN, 10);
    expect_home_at_the_end(INT32_MAX, -10);
}

void test_no_end_of_the_range_is_passed_by_homing(void) {
    expect_home_fails(-5000, -100, INT32_MAX);   /* offset */
    expect_home_fails(5000, 100, 0x80000000U);   /* offset */
    expect_home_fails(5000, 100, INT32_MAX);     /* position: 4900 beyond home */
    expect_home_fails(-5000, -100, 0x80000000U); /* position: 4900 before home */
}

void test_a_halted_drive_does_not_begin_to_search(void) {
    start_homing(34);
    rig_control(0x10F, 0); /* interrupted and halted */
    rig_cycles(2);
    rig_control(0x11F, 0);
    rig_cycles(2);
    TEST_ASSERT_EQUAL_INT(HOMING_INTERRUPTED, rig.node.homing.phase);
}

void test_a_fault_interrupts_the_search(void) {
    start_homing(34);
    follow(30);
    rig_nmt(128); /* 6007h */
    rig_step();
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_REACTION_ACTIVE, rig.node.drive.state);
    TEST_ASSERT_EQUAL_INT(HOMING_INTERRUPTED, rig.node.homing.phase);
    TEST_ASSERT_EQUAL_INT16(0, rig.output.torque_mNm); /* held where it is */
}

void test_injected_index_flag(void) {
    rig_write(0x2F00, 0, 1, 1);
    rig_write(0x6098, 0, 1, 34);
    rig_start();
    rig_inject(700, 0, 0);
    rig_control(0x06, 6);
    rig_cycle();
    rig_inject(700, 0, 0);
    rig_control(0x0F, 0);
    rig_cycle();
    rig_inject(700, 0, 0);
    rig_control(0x1F, 0);
    rig_cycle();
    rig_inject(720, 0, 1);
    rig_cycle();
    TEST_ASSERT_EQUAL_INT32(0, rig.node.od.position_actual_value);
    TEST_ASSERT_TRUE(rig.node.referenced);
}

void test_position_limits_wait_for_a_reference(void) {
    rig_write(0x607D, 2, 4, 4000);
    start_homing(37);
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    TEST_ASSERT_EQUAL_HEX16(0, rig.node.od.statusword & STATUSWORD_WARNING);
}

void test_methods_that_the_drive_does_not_have(void) {
    rig_step();
    for (uint32_t method = 33; method <= 37U; method++) {
        rig_write(0x6098, 0, 1, method);
        rig_step();
        TEST_ASSERT_EQUAL_HEX32(method == 35U || method == 36U ? SDO_ABORT_RANGE : SDO_ABORT_NONE,
                                rig_abort());
    }
}
