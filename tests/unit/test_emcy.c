/* Emergency producer: frame, register, history, inhibit time, queue. */
#include "unity.h"

#include "canopen/emcy.h"

static object_dictionary_t od;
static emcy_t emcy;
static can_frame_t frame;

void setUp(void) {
    object_dictionary_init(2, &od);
    emcy_init(&emcy);
}
void tearDown(void) {}

static bool next(uint32_t elapsed_us) {
    return emcy_next(&od, elapsed_us, true, &emcy, &frame);
}

void test_frame(void) {
    emcy_raise(EMCY_HEARTBEAT, 127, -2, &od, &emcy);
    TEST_ASSERT_TRUE(next(0));
    const uint8_t expected[8] = {0x30, 0x81, 0x11, 127, 0xFE, 0xFF, 0xFF, 0xFF};
    TEST_ASSERT_EQUAL_HEX16(0x082, frame.id);
    TEST_ASSERT_EQUAL_UINT8(8, frame.len);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, frame.data, 8);
    TEST_ASSERT_FALSE(next(1000000));
}

void test_register_lasts_for_errors_only(void) {
    emcy_report(EMCY_SYNC_LENGTH, 0, 0, &od, &emcy);
    TEST_ASSERT_EQUAL_HEX8(0x00, od.error_register);
    emcy_raise(EMCY_OVERSPEED, 0, 0, &od, &emcy);
    TEST_ASSERT_EQUAL_HEX8(0x21, od.error_register);
    emcy_raise(EMCY_MISSED_SYNC, 0, 0, &od, &emcy);
    emcy_raise(EMCY_COMMAND_DEADLINE, 0, 0, &od, &emcy);
    TEST_ASSERT_EQUAL_HEX8(0x31, od.error_register);
    (void)next(0);
    TEST_ASSERT_EQUAL_HEX8(0x11, frame.data[2]);
}

void test_clear_is_sent_once(void) {
    emcy_raise(EMCY_OVERSPEED, 0, 0, &od, &emcy);
    (void)next(0);
    emcy_clear(&od, &emcy);
    emcy_clear(&od, &emcy);
    TEST_ASSERT_EQUAL_HEX8(0, od.error_register);
    TEST_ASSERT_TRUE(next(1000000));
    const uint8_t nothing[8] = {0};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(nothing, frame.data, 8);
    TEST_ASSERT_FALSE(next(1000000));
    TEST_ASSERT_EQUAL_UINT8(1, od.pre_defined_error_field_number_of_errors);
}

void test_history_newest_first(void) {
    for (uint8_t i = 0; i < 10; i++) {
        emcy_report(EMCY_PDO_TOO_SHORT, i, 0, &od, &emcy);
    }
    TEST_ASSERT_EQUAL_UINT8(8, od.pre_defined_error_field_number_of_errors);
    TEST_ASSERT_EQUAL_HEX32(0x00098210, od.pre_defined_error_field[0]);
    TEST_ASSERT_EQUAL_HEX32(0x00028210, od.pre_defined_error_field[7]);
}

void test_inhibit_time(void) {
    od.inhibit_time_emcy = 20; /* 2 ms */
    emcy_report(EMCY_PDO_TOO_SHORT, 1, 0, &od, &emcy);
    emcy_report(EMCY_PDO_TOO_LONG, 2, 0, &od, &emcy);
    TEST_ASSERT_TRUE(next(0));
    TEST_ASSERT_FALSE(next(1000));
    TEST_ASSERT_FALSE(next(999));
    TEST_ASSERT_TRUE(next(1));
    TEST_ASSERT_EQUAL_HEX8(0x20, frame.data[0]);
}

void test_waits_while_nothing_may_be_sent(void) {
    emcy_report(EMCY_PDO_TOO_SHORT, 1, 0, &od, &emcy);
    TEST_ASSERT_FALSE(emcy_next(&od, 1000000, false, &emcy, &frame));
    TEST_ASSERT_TRUE(next(0));
}

void test_full_queue_keeps_the_first_ones(void) {
    od.inhibit_time_emcy = 0;
    for (uint8_t i = 0; i < 20; i++) {
        emcy_report(EMCY_PDO_TOO_SHORT, i, 0, &od, &emcy);
    }
    for (uint8_t i = 0; i < 8; i++) {
        TEST_ASSERT_TRUE(next(0));
        TEST_ASSERT_EQUAL_UINT8(i, frame.data[3]);
    }
    TEST_ASSERT_FALSE(next(0));
}
