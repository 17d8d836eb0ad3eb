/* When a free-running node takes its joint ticks. */
#include "unity.h"

#include "port/posix/tick_schedule.h"

#define MS INT64_C(1000000)

static tick_schedule_t schedule;

void setUp(void) {
    tick_schedule_start(100 * MS, &schedule);
}
void tearDown(void) {}

void test_one_kilohertz_without_sync(void) {
    for (int64_t t = 100 * MS; t < 110 * MS; t += MS) {
        TEST_ASSERT_EQUAL_INT64(t, schedule.next_ns);
        tick_schedule_tick(t + 1000, 1, &schedule); /* a late wake-up does not drift */
    }
}

void test_no_burst_after_a_standstill(void) {
    tick_schedule_tick(500 * MS, 1, &schedule);
    TEST_ASSERT_EQUAL_INT64(501 * MS, schedule.next_ns);
}

void test_ticks_divide_the_sync_period(void) {
    tick_schedule_sync(200 * MS, 5, &schedule);
    TEST_ASSERT_EQUAL_INT64(201 * MS, schedule.next_ns); /* the period is not known yet */
    tick_schedule_sync(202 * MS, 5, &schedule);
    for (int i = 1; i < 5; i++) {
        TEST_ASSERT_EQUAL_INT64(202 * MS + i * 400000, schedule.next_ns);
        tick_schedule_tick(schedule.next_ns, 5, &schedule);
    }
    TEST_ASSERT_EQUAL_INT64(205 * MS, schedule.next_ns); /* the SYNC's turn, half a period late */
}

void test_goes_on_alone_when_sync_stays_away(void) {
    tick_schedule_sync(200 * MS, 1, &schedule);
    tick_schedule_sync(210 * MS, 1, &schedule);
    TEST_ASSERT_EQUAL_INT64(225 * MS, schedule.next_ns);
    tick_schedule_tick(225 * MS, 1, &schedule);
    TEST_ASSERT_EQUAL_INT64(226 * MS, schedule.next_ns);
    tick_schedule_sync(5000 * MS, 1, &schedule); /* too long to be a period */
    TEST_ASSERT_EQUAL_INT64(5001 * MS, schedule.next_ns);
}
