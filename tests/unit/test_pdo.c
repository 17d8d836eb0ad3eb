/* PDO length check, event timing, and the queue of frames. */
#include "unity.h"

#include <string.h>

#include "canopen/frame_queue.h"
#include "canopen/pdo.h"

static rpdo_t rpdo;
static tpdo_event_t tpdo;
static frame_queue_t queue;

void setUp(void) {
    memset(&rpdo, 0, sizeof rpdo);
    memset(&tpdo, 0, sizeof tpdo);
    memset(&queue, 0, sizeof queue);
}
void tearDown(void) {}

static rpdo_result_t receive(uint8_t len) {
    const can_frame_t frame = {.id = 0x201, .len = len};
    return rpdo_receive(6, &frame, &rpdo);
}

void test_lengths(void) {
    TEST_ASSERT_EQUAL_INT(PDO_LENGTH_OK, receive(6).length);
    TEST_ASSERT_EQUAL_INT(PDO_TOO_SHORT, receive(5).length);
    TEST_ASSERT_EQUAL_INT(PDO_TOO_LONG, receive(7).length);
}

void test_a_train_of_bad_frames_is_reported_once(void) {
    TEST_ASSERT_FALSE(receive(6).report);
    TEST_ASSERT_TRUE(receive(5).report);
    TEST_ASSERT_FALSE(receive(4).report);
    TEST_ASSERT_TRUE(receive(8).report);
    TEST_ASSERT_FALSE(receive(6).report);
    TEST_ASSERT_TRUE(receive(8).report);
}

static int sent_in_100_ms(uint32_t inhibit_us, uint32_t event_us, int change_every_ms) {
    int sent = 0;
    for (int ms = 1; ms <= 100; ms++) {
        const bool changed = change_every_ms != 0 && ms % change_every_ms == 0;
        sent += tpdo_event_due(inhibit_us, event_us, 1000, changed, &tpdo) ? 1 : 0;
    }
    return sent;
}

void test_event_timer(void) {
    TEST_ASSERT_EQUAL_INT(4, sent_in_100_ms(20000, 25000, 0));
    TEST_ASSERT_EQUAL_INT(0, sent_in_100_ms(20000, 0, 0));
}

void test_inhibit_time_collects_changes(void) {
    TEST_ASSERT_EQUAL_INT(5, sent_in_100_ms(20000, 0, 1));
    TEST_ASSERT_EQUAL_INT(2, sent_in_100_ms(20000, 0, 50));
}

void test_a_change_within_the_inhibit_time_is_not_lost(void) {
    TEST_ASSERT_FALSE(tpdo_event_due(20000, 0, 1000, true, &tpdo));
    TEST_ASSERT_FALSE(tpdo_event_due(20000, 0, 18000, false, &tpdo));
    TEST_ASSERT_TRUE(tpdo_event_due(20000, 0, 1000, false, &tpdo));
    TEST_ASSERT_FALSE(tpdo_event_due(20000, 0, 100000, false, &tpdo));
}

void test_queue_keeps_order_across_its_end(void) {
    can_frame_t frame = {.id = 0, .len = 0};
    for (uint16_t round = 0; round < 3; round++) {
        for (uint16_t i = 0; i < FRAME_QUEUE_SIZE - 7U; i++) {
            frame.id = i;
            TEST_ASSERT_TRUE(frame_queue_push(&frame, &queue));
        }
        for (uint16_t i = 0; i < FRAME_QUEUE_SIZE - 7U; i++) {
            TEST_ASSERT_TRUE(frame_queue_pop(&queue, &frame));
            TEST_ASSERT_EQUAL_UINT16(i, frame.id);
        }
    }
    TEST_ASSERT_FALSE(frame_queue_pop(&queue, &frame));
}

void test_full_queue_refuses(void) {
    const can_frame_t frame = {.id = 1, .len = 0};
    for (size_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_TRUE(frame_queue_push(&frame, &queue));
    }
    TEST_ASSERT_FALSE(frame_queue_push(&frame, &queue));
    TEST_ASSERT_EQUAL_UINT(FRAME_QUEUE_SIZE, queue.count);
}
