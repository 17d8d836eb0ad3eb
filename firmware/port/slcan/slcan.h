/**
 * SLCAN, the serial-line form of CAN (LAWICEL CAN232/CANUSB manual, "Available ASCII commands"):
 * bytes to lines, and 11-bit data frames to lines "tiiildd..." and back.
 *
 * A line is 1 to SLCAN_LINE_MAX printable ASCII characters, then CR. Every line is answered: CR
 * (or text and CR) when it was taken, BEL when it was refused.
 */
#ifndef SLCAN_H
#define SLCAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SLCAN_CR '\r'
#define SLCAN_BEL '\a'
/** 't', identifier, length, 8 data bytes in hexadecimal; without CR. */
#define SLCAN_LINE_MAX 21U
/** Room for a line with its CR. */
#define SLCAN_TEXT_MAX (SLCAN_LINE_MAX + 1U)

/** The line under way; all zero at the beginning. */
typedef struct {
    char text[SLCAN_LINE_MAX];
    uint8_t length;
    bool garbled;  /**< a character of it was lost, is not printable, or is one too many */
    bool complete; /**< the next byte begins a new line */
} slcan_line_t;

typedef enum {
    SLCAN_PENDING, /**< the line goes on */
    SLCAN_LINE,    /**< line->text is whole, line->length characters; 0 for a CR alone */
    SLCAN_GARBLED  /**< the line has ended and is to be refused */
} slcan_event_t;

/** Takes in one byte. A garbled line is skipped up to its CR. */
slcan_event_t slcan_receive(uint8_t byte, slcan_line_t *line);

/** Bytes were lost (receiver overrun, framing error): the line under way is garbled. */
void slcan_lose(slcan_line_t *line);

/** False when the text is not exactly one 11-bit data frame; hexadecimal digits of either case. */
bool slcan_to_frame(const char *text, size_t length, can_frame_t *frame);

/** Writes the frame (id <= 7FFh, len <= 8) as a line with its CR; returns the characters written,
 * 6 to SLCAN_TEXT_MAX. No terminating zero. */
size_t slcan_from_frame(const can_frame_t *frame, char text[SLCAN_TEXT_MAX]);

#ifdef __cplusplus
}
#endif

#endif
