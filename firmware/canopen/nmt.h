/**
 * NMT slave (CiA 301, 7.2.8.3): the communication state of the node and the commands that change
 * it.
 */
#ifndef NMT_H
#define NMT_H

#include <stdint.h>

#include "canopen/can_frame.h"

#define NMT_COB_ID 0x000U

/** Values as the heartbeat carries them. */
typedef enum {
    NMT_BOOT_UP = 0,
    NMT_STOPPED = 4,
    NMT_OPERATIONAL = 5,
    NMT_PRE_OPERATIONAL = 127
} nmt_state_t;

typedef enum { NMT_NO_RESET, NMT_RESET_NODE, NMT_RESET_COMMUNICATION } nmt_reset_t;

/** Takes in one frame with COB-ID 000h. Unknown commands and other nodes' ones change nothing. */
nmt_reset_t nmt_receive(uint8_t node_id, const can_frame_t *frame, nmt_state_t *state);

#endif
