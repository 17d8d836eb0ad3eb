#include "node/tick_closing.h"

#include "unity.h"

static motor_node_t node;
static tick_closing_t closing;
static uint32_t elapsed_us;

void setUp(void) {
    const motor_node_config_t config = {.node_id = 5, .time_base = 1, .sensor_source = 1};
    motor_node_init(&config, &node);
    closing = (tick_closing_t){0};
    elapsed_us = 77;
}

void tearDown(void) {}

static tick_closing_event_t receive(uint16_t id, uint8_t len, uint8_t tick) {
    const can_frame_t frame = {.id = id, .len = len, .data = {0, 0, 0, 0, tick}};
    return tick_closing_receive(&node, &frame, &closing, &elapsed_us);
}

void test_own_rpdo4_closes_the_tick_before_operational(void) {
    TEST_ASSERT_EQUAL(NMT_PRE_OPERATIONAL, node.nmt);
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 200));
    TEST_ASSERT_EQUAL_UINT32(1000, elapsed_us);
}

void test_other_frames_wait(void) {
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x506, 8, 1));
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x080, 1, 1));
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x205, 8, 1));
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x505, 4, 1)); /* no tick number in it */
    TEST_ASSERT_EQUAL_UINT32(77, elapsed_us);
}

void test_elapsed_time_is_the_difference_of_tick_numbers_across_the_wrap(void) {
    node.od.communication_cycle_period = 2000;
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 254));
    TEST_ASSERT_EQUAL_UINT32(2000, elapsed_us);
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 1));
    TEST_ASSERT_EQUAL_UINT32(3 * 2000, elapsed_us);
}

void test_a_repeated_tick_number_closes_nothing(void) {
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 9));
    elapsed_us = 77;
    TEST_ASSERT_EQUAL(TICK_REPEATED, receive(0x505, 8, 9));
    TEST_ASSERT_EQUAL_UINT32(77, elapsed_us);
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 10));
    TEST_ASSERT_EQUAL_UINT32(1000, elapsed_us);
}

void test_elapsed_time_is_bounded(void) {
    node.od.communication_cycle_period = 20000;
    (void)receive(0x505, 8, 0);
    (void)receive(0x505, 8, 255);
    TEST_ASSERT_EQUAL_UINT32(1000000, elapsed_us);
}

void test_nothing_closes_in_the_free_running_time_base(void) {
    (void)receive(0x505, 8, 9);
    node.od.time_base = 0;
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x505, 8, 10));
    node.od.time_base = 1; /* set anew: what was before does not count */
    TEST_ASSERT_EQUAL(TICK_CLOSED, receive(0x505, 8, 100));
    TEST_ASSERT_EQUAL_UINT32(1000, elapsed_us);
}

void test_a_node_without_id_has_no_rpdo4(void) {
    node.node_id = LSS_UNCONFIGURED;
    TEST_ASSERT_EQUAL(TICK_GOES_ON, receive(0x500 + 255, 8, 1));
}
