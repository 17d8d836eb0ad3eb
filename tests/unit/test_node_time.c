/* Node time and the counters of object 2201h stop at their ends. */
#include "unity.h"

#include "canopen/node_time.h"

void setUp(void) {}
void tearDown(void) {}

void test_time_stops_at_its_end(void) {
    TEST_ASSERT_EQUAL_UINT32(3000, node_time_add(1000, 2000));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, node_time_add(UINT32_MAX - 5U, 5));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, node_time_add(UINT32_MAX - 5U, 6));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, node_time_add(UINT32_MAX, UINT32_MAX));
}

void test_counters_stop_at_their_end(void) {
    uint16_t counter = 65530;
    node_count(&counter, 5);
    TEST_ASSERT_EQUAL_UINT16(65535, counter);
    node_count(&counter, 1);
    TEST_ASSERT_EQUAL_UINT16(65535, counter);
    counter = 7;
    node_count(&counter, UINT32_MAX);
    TEST_ASSERT_EQUAL_UINT16(65535, counter);
}
