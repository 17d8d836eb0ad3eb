#include "port/slcan/slcan.h"

#include <string.h>

#define HEAD 5U /* 't', three digits of the identifier, the length */
#define DATA_MAX 8U
#define ID_MAX 0x7FFU
#define NO_DIGIT 16U

slcan_event_t slcan_receive(uint8_t byte, slcan_line_t *line) {
    if (line->complete) {
        memset(line, 0, sizeof *line);
    }
    if (byte == (uint8_t)SLCAN_CR) {
        line->complete = true;
        return line->garbled ? SLCAN_GARBLED : SLCAN_LINE;
    }
    if (byte < (uint8_t)' ' || byte > (uint8_t)'~' || line->length == SLCAN_LINE_MAX) {
        line->garbled = true;
    } else {
        line->text[line->length] = (char)byte;
        line->length++;
    }
    return SLCAN_PENDING;
}

void slcan_lose(slcan_line_t *line) {
    if (line->complete) {
        memset(line, 0, sizeof *line);
    }
    line->garbled = true;
}

/** Value of a hexadecimal digit, else NO_DIGIT. */
static uint16_t digit_value(char digit) {
    if (digit >= '0' && digit <= '9') {
        return (uint16_t)(digit - '0');
    }
    if (digit >= 'A' && digit <= 'F') {
        return (uint16_t)(digit - 'A' + 10);
    }
    if (digit >= 'a' && digit <= 'f') {
        return (uint16_t)(digit - 'a' + 10);
    }
    return NO_DIGIT;
}

static bool read_hex(const char *text, size_t digits, uint16_t *value) {
    *value = 0;
    for (size_t i = 0; i < digits; i++) {
        const uint16_t digit = digit_value(text[i]);
        if (digit == NO_DIGIT) {
            return false;
        }
        *value = (uint16_t)((unsigned)*value << 4U | digit);
    }
    return true;
}

bool slcan_to_frame(const char *text, size_t length, can_frame_t *frame) {
    uint16_t count = 0;
    memset(frame, 0, sizeof *frame);
    if (length < HEAD || text[0] != 't' || !read_hex(&text[1], 3, &frame->id) ||
        frame->id > ID_MAX || !read_hex(&text[HEAD - 1U], 1, &count) || count > DATA_MAX ||
        length != HEAD + 2U * (size_t)count) {
        return false;
    }
    frame->len = (uint8_t)count;
    for (size_t i = 0; i < count; i++) {
        uint16_t byte = 0;
        if (!read_hex(&text[HEAD + 2U * i], 2, &byte)) {
            return false;
        }
        frame->data[i] = (uint8_t)byte;
    }
    return true;
}

size_t slcan_from_frame(const can_frame_t *frame, char text[SLCAN_TEXT_MAX]) {
    static const char hex[] = "0123456789ABCDEF";
    size_t length = HEAD;
    text[0] = 't';
    text[1] = hex[(unsigned)frame->id >> 8U & 0xFU];
    text[2] = hex[(unsigned)frame->id >> 4U & 0xFU];
    text[3] = hex[(unsigned)frame->id & 0xFU];
    text[4] = hex[(unsigned)frame->len & 0xFU];
    for (size_t i = 0; i < frame->len && i < DATA_MAX; i++) {
        text[length] = hex[(unsigned)frame->data[i] >> 4U];
        text[length + 1U] = hex[(unsigned)frame->data[i] & 0xFU];
        length += 2U;
    }
    text[length] = SLCAN_CR;
    return length + 1U;
}
