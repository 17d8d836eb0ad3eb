/**
 * One classical CAN frame with an 11-bit identifier: what crosses the seam between node and bus.
 *
 * id: 0..0x7FF; len: 0..8; data: bytes from len on are zero.
 */
#ifndef CAN_FRAME_H
#define CAN_FRAME_H

#include <stdint.h>

typedef struct {
    uint16_t id;
    uint8_t len;
    uint8_t data[8];
} can_frame_t;

#endif
