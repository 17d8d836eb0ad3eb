/* Drive state machine: every transition of CiA 402-2, and every pair of state and command. */
#include "unity.h"

#include "cia402/drive_state.h"

#define SHUTDOWN 0x06U
#define SWITCH_ON 0x07U
#define ENABLE 0x0FU
#define QUICK_STOP 0x02U
#define DISABLE_VOLTAGE 0x00U
#define FAULT_RESET 0x80U

static drive_t drive;
static drive_options_t options;

void setUp(void) {
    const drive_options_t defaults = {
        .quick_stop = 2, .shutdown = 1, .disable_operation = 1, .fault_reaction = 2};
    options = defaults;
    drive_init(&drive);
}
void tearDown(void) {}

static drive_result_t command(uint16_t controlword) {
    return drive_command(&options, true, controlword, &drive);
}

static void expect(drive_state_t state) {
    TEST_ASSERT_EQUAL_INT(state, drive.state);
}

static void enter(drive_state_t state) {
    drive_init(&drive);
    drive.state = state;
    drive.next = state;
}

static void enable(void) {
    (void)command(SHUTDOWN);
    (void)command(SWITCH_ON);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLED, command(ENABLE));
}

void test_up_and_down(void) {
    expect(DRIVE_SWITCH_ON_DISABLED); /* 0, 1 */
    (void)command(SHUTDOWN);
    expect(DRIVE_READY_TO_SWITCH_ON); /* 2 */
    (void)command(SWITCH_ON);
    expect(DRIVE_SWITCHED_ON); /* 3 */
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLED, command(ENABLE));
    expect(DRIVE_OPERATION_ENABLED); /* 4 */
    TEST_ASSERT_EQUAL_INT(DRIVE_STOPPING, command(SWITCH_ON));
    TEST_ASSERT_FALSE(drive_wants_output(&drive));
    drive_bound_is_zero(&drive);
    expect(DRIVE_SWITCHED_ON); /* 5 */
    (void)command(SHUTDOWN);
    expect(DRIVE_READY_TO_SWITCH_ON); /* 6 */
    (void)command(DISABLE_VOLTAGE);
    expect(DRIVE_SWITCH_ON_DISABLED); /* 7 */
}

void test_enable_from_ready_takes_two_transitions(void) {
    (void)command(SHUTDOWN);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLED, command(ENABLE));
    expect(DRIVE_OPERATION_ENABLED);
}

void test_refused_enabling_stays_switched_on(void) {
    (void)command(SHUTDOWN);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLE_REFUSED, drive_command(&options, false, ENABLE, &drive));
    expect(DRIVE_SWITCHED_ON);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLE_REFUSED, drive_command(&options, false, ENABLE, &drive));
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLED, command(ENABLE));
}

void test_shutdown_from_operation(void) { /* 8 */
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_STOPPING, command(SHUTDOWN));
    expect(DRIVE_OPERATION_ENABLED);
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, command(SWITCH_ON)); /* the first word counts */
    drive_bound_is_zero(&drive);
    expect(DRIVE_READY_TO_SWITCH_ON);
}

void test_disabling_operation_under_way_is_not_turned_into_a_shutdown(void) {
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_STOPPING, command(SWITCH_ON));
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, command(SHUTDOWN)); /* the first word counts */
    drive_bound_is_zero(&drive);
    expect(DRIVE_SWITCHED_ON);
}

void test_leaving_operation_without_ramp(void) {
    options.shutdown = 0;
    options.disable_operation = 0;
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, command(SWITCH_ON));
    expect(DRIVE_SWITCHED_ON);
    (void)command(ENABLE);
    (void)command(SHUTDOWN);
    expect(DRIVE_READY_TO_SWITCH_ON);
}

void test_disable_voltage_is_immediate(void) { /* 9 */
    enable();
    (void)command(DISABLE_VOLTAGE);
    expect(DRIVE_SWITCH_ON_DISABLED);
    TEST_ASSERT_FALSE(drive_has_output(&drive));
}

void test_quick_stop_before_operation(void) { /* 7, 10 */
    (void)command(SHUTDOWN);
    (void)command(QUICK_STOP);
    expect(DRIVE_SWITCH_ON_DISABLED);
    (void)command(SHUTDOWN);
    (void)command(SWITCH_ON);
    (void)command(QUICK_STOP);
    expect(DRIVE_SWITCH_ON_DISABLED);
}

void test_quick_stop_ramps_then_switches_off(void) { /* 11, 12 */
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_STOPPING, command(QUICK_STOP));
    expect(DRIVE_QUICK_STOP_ACTIVE);
    TEST_ASSERT_TRUE(drive_has_output(&drive));
    (void)command(ENABLE);
    expect(DRIVE_QUICK_STOP_ACTIVE);
    drive_bound_is_zero(&drive);
    expect(DRIVE_SWITCH_ON_DISABLED);
}

void test_quick_stop_that_stays(void) { /* 11, 16 */
    options.quick_stop = 6;
    enable();
    (void)command(QUICK_STOP);
    drive_bound_is_zero(&drive);
    expect(DRIVE_QUICK_STOP_ACTIVE);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLE_REFUSED, drive_command(&options, false, ENABLE, &drive));
    expect(DRIVE_QUICK_STOP_ACTIVE);
    TEST_ASSERT_EQUAL_INT(DRIVE_ENABLED, command(ENABLE));
    expect(DRIVE_OPERATION_ENABLED);
    (void)command(QUICK_STOP);
    (void)command(DISABLE_VOLTAGE);
    expect(DRIVE_SWITCH_ON_DISABLED);
}

void test_quick_stop_without_ramp(void) {
    options.quick_stop = 0;
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, command(QUICK_STOP));
    expect(DRIVE_SWITCH_ON_DISABLED);
}

void test_fault_in_operation(void) { /* 13, 14, 15 */
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_STOPPING, drive_fault(&options, true, &drive));
    expect(DRIVE_FAULT_REACTION_ACTIVE);
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, drive_fault(&options, true, &drive));
    (void)command(FAULT_RESET);
    expect(DRIVE_FAULT_REACTION_ACTIVE);
    drive_bound_is_zero(&drive);
    expect(DRIVE_FAULT);
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, command(FAULT_RESET)); /* no rising edge */
    expect(DRIVE_FAULT);
    (void)command(ENABLE);
    expect(DRIVE_FAULT);
    TEST_ASSERT_EQUAL_INT(DRIVE_FAULT_RESET, command(FAULT_RESET));
    expect(DRIVE_SWITCH_ON_DISABLED);
}

void test_fault_without_ramp(void) {
    enable();
    TEST_ASSERT_EQUAL_INT(DRIVE_DONE, drive_fault(&options, false, &drive));
    expect(DRIVE_FAULT);
    enter(DRIVE_OPERATION_ENABLED);
    options.fault_reaction = 0;
    (void)drive_fault(&options, true, &drive);
    expect(DRIVE_FAULT);
}

void test_severe_fault_cuts_a_ramp_short(void) {
    enable();
    (void)drive_fault(&options, true, &drive);
    (void)drive_fault(&options, false, &drive);
    expect(DRIVE_FAULT);
}

void test_fault_without_output_needs_no_ramp(void) {
    (void)drive_fault(&options, true, &drive);
    expect(DRIVE_FAULT);
    (void)drive_fault(&options, true, &drive);
    expect(DRIVE_FAULT);
}

void test_statusword_of_each_state(void) {
    const uint16_t words[] = {0x0000, 0x0060, 0x0021, 0x0023, 0x0027, 0x0007, 0x002F, 0x0028};
    for (int state = DRIVE_NOT_READY_TO_SWITCH_ON; state <= DRIVE_FAULT; state++) {
        enter((drive_state_t)state);
        TEST_ASSERT_EQUAL_HEX16(words[state], drive_statusword(&drive));
    }
}

void test_every_state_with_every_command(void) {
    const uint16_t words[] = {DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN,
                              SWITCH_ON,       ENABLE,     FAULT_RESET};
    const drive_state_t nr = DRIVE_NOT_READY_TO_SWITCH_ON;
    const drive_state_t sd = DRIVE_SWITCH_ON_DISABLED;
    const drive_state_t rs = DRIVE_READY_TO_SWITCH_ON;
    const drive_state_t so = DRIVE_SWITCHED_ON;
    const drive_state_t oe = DRIVE_OPERATION_ENABLED;
    const drive_state_t qs = DRIVE_QUICK_STOP_ACTIVE;
    const drive_state_t fr = DRIVE_FAULT_REACTION_ACTIVE;
    const drive_state_t fa = DRIVE_FAULT;
    const drive_state_t expected[8][6] = {{nr, nr, nr, nr, nr, nr}, {sd, sd, rs, sd, sd, sd},
                                          {sd, sd, rs, so, oe, rs}, {sd, sd, rs, so, oe, so},
                                          {sd, qs, oe, oe, oe, oe}, {sd, qs, qs, qs, qs, qs},
                                          {fr, fr, fr, fr, fr, fr}, {fa, fa, fa, fa, fa, sd}};
    for (int state = 0; state < 8; state++) {
        for (int i = 0; i < 6; i++) {
            enter((drive_state_t)state);
            (void)command(words[i]);
            TEST_ASSERT_EQUAL_INT(expected[state][i], drive.state);
        }
    }
}
