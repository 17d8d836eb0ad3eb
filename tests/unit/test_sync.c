/* SYNC: counter, duplicates, jumps, length, and SYNCs missed in node time. */
#include "unity.h"

#include "canopen/sync.h"

static sync_t sync;
static sync_config_t config;

void setUp(void) {
    const sync_t fresh = {0};
    sync = fresh;
    config.overflow = 240;
    config.period_us = 1000;
}
void tearDown(void) {}

static sync_result_t receive(uint8_t counter) {
    const can_frame_t frame = {.id = 0x80, .len = 1, .data = {counter}};
    return sync_receive(&config, &frame, &sync);
}

static sync_result_t receive_bare(void) {
    const can_frame_t frame = {.id = 0x80, .len = 0};
    return sync_receive(&config, &frame, &sync);
}

void test_counter_runs_and_wraps(void) {
    for (int i = 0; i < 500; i++) {
        const sync_result_t result = receive((uint8_t)(i % 240 + 1));
        TEST_ASSERT_TRUE(result.acts);
        TEST_ASSERT_FALSE(result.duplicate || result.jump || result.report_length);
    }
}

void test_duplicate_does_not_act(void) {
    (void)receive(7);
    const sync_result_t result = receive(7);
    TEST_ASSERT_FALSE(result.acts);
    TEST_ASSERT_TRUE(result.duplicate);
    TEST_ASSERT_TRUE(receive(8).acts);
}

void test_jump_acts_once(void) {
    (void)receive(7);
    const sync_result_t result = receive(10);
    TEST_ASSERT_TRUE(result.acts);
    TEST_ASSERT_TRUE(result.jump);
    TEST_ASSERT_EQUAL_UINT32(0, result.missed); /* node time counts them */
    TEST_ASSERT_FALSE(receive(10).acts);
    TEST_ASSERT_FALSE(receive(11).jump);
}

void test_jump_counts_as_missed_without_a_period(void) {
    config.period_us = 0;
    (void)receive(239);
    TEST_ASSERT_EQUAL_UINT32(3, receive(3).missed);
    TEST_ASSERT_EQUAL_UINT32(3, sync.overdue);
    TEST_ASSERT_EQUAL_UINT32(0, receive(4).missed);
    TEST_ASSERT_EQUAL_UINT32(0, sync.overdue);
}

void test_either_length_acts_and_the_wrong_one_is_reported_once(void) {
    (void)receive(1);
    sync_result_t result = receive_bare();
    TEST_ASSERT_TRUE(result.acts);
    TEST_ASSERT_TRUE(result.report_length);
    TEST_ASSERT_FALSE(receive_bare().report_length);
    sync_restart(&sync);
    TEST_ASSERT_FALSE(receive_bare().report_length);
}

void test_counter_is_ignored_when_none_is_configured(void) {
    config.overflow = 0;
    TEST_ASSERT_TRUE(receive(5).report_length);
    TEST_ASSERT_TRUE(receive(5).acts);
    TEST_ASSERT_FALSE(receive(9).jump);
    TEST_ASSERT_FALSE(receive_bare().report_length);
}

void test_missed_in_node_time(void) {
    (void)receive(1);
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 1000, &sync));
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 499, &sync));
    TEST_ASSERT_EQUAL_UINT32(1, sync_elapse(&config, 1, &sync));
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 999, &sync));
    TEST_ASSERT_EQUAL_UINT32(1, sync_elapse(&config, 1, &sync));
    TEST_ASSERT_EQUAL_UINT32(2, sync.overdue);
    (void)receive(4);
    TEST_ASSERT_EQUAL_UINT32(0, sync.overdue);
    TEST_ASSERT_EQUAL_UINT32(9, sync_elapse(&config, 10000, &sync));
}

void test_nothing_is_missed_within_the_period(void) {
    (void)receive(1);
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 999, &sync));
    TEST_ASSERT_EQUAL_UINT32(0, sync.overdue);
    (void)receive(2);
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 600, &sync)); /* counted from the last one */
    TEST_ASSERT_EQUAL_UINT32(0, sync.overdue);
}

void test_nothing_is_missed_before_the_first_sync_or_without_period(void) {
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 5000, &sync));
    config.period_us = 0;
    (void)receive(1);
    TEST_ASSERT_EQUAL_UINT32(0, sync_elapse(&config, 5000, &sync));
}

void test_restart_takes_any_counter(void) {
    (void)receive(100);
    sync_restart(&sync);
    const sync_result_t result = receive(3);
    TEST_ASSERT_TRUE(result.acts);
    TEST_ASSERT_FALSE(result.jump);
}
