/* Heartbeat: produced in node time; consumed with several entries. */
#include "unity.h"

#include <string.h>

#include "canopen/heartbeat.h"

static heartbeat_producer_t producer;
static heartbeat_consumer_t consumer;
static uint32_t times[HEARTBEAT_CONSUMERS];

void setUp(void) {
    memset(&producer, 0, sizeof producer);
    memset(&consumer, 0, sizeof consumer);
    memset(times, 0, sizeof times);
    times[0] = 127U << 16 | 50U;
    times[2] = 2U << 16 | 200U;
}
void tearDown(void) {}

static void hear(uint8_t node_id, uint8_t state) {
    const can_frame_t frame = {.id = (uint16_t)(0x700 + node_id), .len = 1, .data = {state}};
    heartbeat_receive(times, &frame, &consumer);
}

static uint8_t elapse(uint32_t elapsed_us) {
    heartbeat_elapse(elapsed_us, &consumer);
    return heartbeat_lost(times, &consumer);
}

void test_producer_period(void) {
    int sent = 0;
    for (int i = 0; i < 1000; i++) {
        sent += heartbeat_due(100, 1000, &producer) ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_INT(10, sent);
    TEST_ASSERT_FALSE(heartbeat_due(0, 1000000, &producer));
}

void test_frame(void) {
    const can_frame_t frame = heartbeat_frame(3, NMT_OPERATIONAL);
    TEST_ASSERT_EQUAL_HEX16(0x703, frame.id);
    TEST_ASSERT_EQUAL_UINT8(1, frame.len);
    TEST_ASSERT_EQUAL_HEX8(5, frame.data[0]);
}

void test_watching_begins_with_the_first_heartbeat(void) {
    TEST_ASSERT_EQUAL_UINT8(0, elapse(1000000));
    hear(127, 5);
    TEST_ASSERT_EQUAL_UINT8(0, elapse(49999));
    TEST_ASSERT_EQUAL_UINT8(127, elapse(1));
    TEST_ASSERT_EQUAL_UINT8(0, elapse(1000000));
}

void test_heartbeats_keep_it_alive_and_a_new_one_watches_again(void) {
    hear(127, 5);
    for (int i = 0; i < 10; i++) {
        TEST_ASSERT_EQUAL_UINT8(0, elapse(40000));
        hear(127, 5);
    }
    TEST_ASSERT_EQUAL_UINT8(127, elapse(50000));
    hear(127, 127);
    TEST_ASSERT_EQUAL_UINT8(127, elapse(50000));
}

void test_entries_are_independent(void) {
    hear(127, 5);
    hear(2, 5);
    TEST_ASSERT_EQUAL_UINT8(127, elapse(60000));
    TEST_ASSERT_EQUAL_UINT8(0, elapse(100000));
    TEST_ASSERT_EQUAL_UINT8(2, elapse(40000));
}

void test_two_lost_at_once_are_reported_one_after_the_other(void) {
    hear(127, 5);
    hear(2, 5);
    TEST_ASSERT_EQUAL_UINT8(127, elapse(500000));
    TEST_ASSERT_EQUAL_UINT8(2, elapse(0));
}

void test_what_is_no_heartbeat_of_a_watched_node(void) {
    hear(3, 5);
    hear(127, 0); /* boot-up */
    const can_frame_t two_bytes = {.id = 0x77F, .len = 2, .data = {5, 0}};
    heartbeat_receive(times, &two_bytes, &consumer);
    TEST_ASSERT_EQUAL_UINT8(0, elapse(1000000));
}

void test_entry_switched_off(void) {
    hear(127, 5);
    times[0] = 0;
    consumer.entries[0].watching = false; /* as the node does when 1016h is written */
    TEST_ASSERT_EQUAL_UINT8(0, elapse(1000000));
}
