/**
 * What PDOs need beyond packing (CiA 301, 7.2.2): the length check of a received one, and the
 * timing of an event-driven one that is sent.
 */
#ifndef PDO_H
#define PDO_H

#include <stdbool.h>
#include <stdint.h>

#include "canopen/can_frame.h"

typedef enum { PDO_LENGTH_OK, PDO_TOO_SHORT, PDO_TOO_LONG } pdo_length_t;

/** One state per RPDO, so that a train of bad frames is reported once. */
typedef struct {
    pdo_length_t last;
} rpdo_t;

typedef struct {
    pdo_length_t
        length;  /**< PDO_TOO_SHORT: not to be processed; PDO_TOO_LONG: its first bytes are */
    bool report; /**< first one with this fault since a good one: error 8210h or 8220h */
} rpdo_result_t;

/** Takes in one frame of an RPDO that maps length bytes, 0..8. */
rpdo_result_t rpdo_receive(uint8_t length, const can_frame_t *frame, rpdo_t *rpdo);

typedef struct {
    uint32_t since_us; /**< since it was sent */
    bool changed;      /**< a change waits for the inhibit time */
} tpdo_event_t;

/**
 * True when the PDO is to be sent now: changed and not within the inhibit time, or the event timer
 * has run out (0 = no timer).
 */
bool tpdo_event_due(uint32_t inhibit_us, uint32_t event_us, uint32_t elapsed_us, bool changed,
                    tpdo_event_t *tpdo);

#endif
