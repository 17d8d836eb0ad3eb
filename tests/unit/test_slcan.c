/* Bytes to SLCAN lines, frames to lines and back. */
#include <string.h>

#include "unity.h"

#include "port/slcan/slcan.h"

static slcan_line_t line;

void setUp(void) {
    memset(&line, 0, sizeof line);
}
void tearDown(void) {}

/* What the last byte of a text gives; none before it may end a line. */
static slcan_event_t feed(const char *text) {
    slcan_event_t event = SLCAN_PENDING;
    for (size_t i = 0; text[i] != '\0'; i++) {
        TEST_ASSERT_EQUAL_INT(SLCAN_PENDING, event);
        event = slcan_receive((uint8_t)text[i], &line);
    }
    return event;
}

static bool parse(const char *text, can_frame_t *frame) {
    return slcan_to_frame(text, strlen(text), frame);
}

void test_a_line_ends_with_cr(void) {
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("t0801A5\r"));
    TEST_ASSERT_EQUAL_UINT8(7, line.length);
    TEST_ASSERT_EQUAL_MEMORY("t0801A5", line.text, 7);
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("V\r"));
    TEST_ASSERT_EQUAL_UINT8(1, line.length);
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("\r"));
    TEST_ASSERT_EQUAL_UINT8(0, line.length);
}

void test_the_longest_line_fits_and_one_more_is_garbled(void) {
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("t20180011223344556677\r"));
    TEST_ASSERT_EQUAL_UINT8(SLCAN_LINE_MAX, line.length);
    TEST_ASSERT_EQUAL_INT(SLCAN_GARBLED, feed("t201800112233445566770\r"));
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("O\r"));
}

void test_an_endless_line_is_bounded(void) {
    for (uint32_t i = 0; i < 100000U; i++) {
        TEST_ASSERT_EQUAL_INT(SLCAN_PENDING, slcan_receive('A', &line));
    }
    TEST_ASSERT_EQUAL_INT(SLCAN_GARBLED, feed("\r"));
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("F\r"));
}

void test_every_byte_that_is_not_printable_garbles_its_line(void) {
    for (unsigned byte = 0; byte < 256U; byte++) {
        const bool printable = byte >= 0x20U && byte <= 0x7EU;
        if (byte == (unsigned)SLCAN_CR) {
            continue;
        }
        (void)slcan_receive('t', &line);
        TEST_ASSERT_EQUAL_INT(SLCAN_PENDING, slcan_receive((uint8_t)byte, &line));
        TEST_ASSERT_EQUAL_INT(printable ? SLCAN_LINE : SLCAN_GARBLED, feed("\r"));
    }
}

void test_lost_bytes_garble_the_line_under_way(void) {
    (void)feed("t0801");
    slcan_lose(&line);
    TEST_ASSERT_EQUAL_INT(SLCAN_GARBLED, feed("A5\r"));
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("t0801A5\r"));
    slcan_lose(&line); /* the first bytes of the next line */
    TEST_ASSERT_EQUAL_INT(SLCAN_GARBLED, feed("801A5\r"));
    TEST_ASSERT_EQUAL_INT(SLCAN_LINE, feed("t0801A5\r"));
}

void test_a_frame_and_its_line(void) {
    const can_frame_t frame = {
        .id = 0x5A3, .len = 8, .data = {0, 1, 0x9F, 0xAB, 0xCD, 0xEF, 0xF0, 0xFF}};
    char text[SLCAN_TEXT_MAX + 1U];
    memset(text, '#', sizeof text);
    TEST_ASSERT_EQUAL_UINT(22, slcan_from_frame(&frame, text));
    TEST_ASSERT_EQUAL_MEMORY("t5A3800019FABCDEFF0FF\r#", text, 23);
}

void test_all_identifiers_and_lengths_come_back(void) {
    for (uint16_t id = 0; id <= 0x7FFU; id++) {
        can_frame_t frame = {.id = id, .len = (uint8_t)(id % 9U)};
        can_frame_t back;
        char text[SLCAN_TEXT_MAX];
        for (uint8_t i = 0; i < frame.len; i++) {
            frame.data[i] = (uint8_t)(id * 31U + i * 97U);
        }
        const size_t length = slcan_from_frame(&frame, text);
        TEST_ASSERT_EQUAL_UINT(6U + 2U * frame.len, length);
        TEST_ASSERT_TRUE(slcan_to_frame(text, length - 1U, &back));
        TEST_ASSERT_EQUAL_UINT16(frame.id, back.id);
        TEST_ASSERT_EQUAL_UINT8(frame.len, back.len);
        TEST_ASSERT_EQUAL_MEMORY(frame.data, back.data, 8);
    }
}

void test_small_letters_are_digits_too(void) {
    can_frame_t frame;
    TEST_ASSERT_TRUE(parse("t7ff2abCd", &frame));
    TEST_ASSERT_EQUAL_UINT16(0x7FF, frame.id);
    TEST_ASSERT_EQUAL_UINT8(0xAB, frame.data[0]);
    TEST_ASSERT_EQUAL_UINT8(0xCD, frame.data[1]);
}

void test_what_is_no_frame(void) {
    static const char *const wrong[] = {"",
                                        "t",
                                        "t080",
                                        "t08",
                                        "t0809",
                                        "t080A",
                                        "t8000",
                                        "t0801",
                                        "t0801A",
                                        "t0801A5A",
                                        "t0800A5",
                                        "tG800",
                                        "t0g00",
                                        "t08 0",
                                        "t0801G0",
                                        "t08010G",
                                        "T0000008000",
                                        "r0800",
                                        "x0801A5",
                                        "t08-1A5",
                                        "t080:",
                                        "t080@",
                                        "t080`",
                                        "t0801/0",
                                        "t20190011223344556677",
                                        "t0808001122334455667"};
    can_frame_t frame;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(parse(wrong[i], &frame), wrong[i]);
    }
}
