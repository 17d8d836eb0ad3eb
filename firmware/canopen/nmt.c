#include "canopen/nmt.h"

#define COMMAND_START 1U
#define COMMAND_STOP 2U
#define COMMAND_PRE_OPERATIONAL 128U
#define COMMAND_RESET_NODE 129U
#define COMMAND_RESET_COMMUNICATION 130U

nmt_reset_t nmt_receive(uint8_t node_id, const can_frame_t *frame, nmt_state_t *state) {
    if (frame->len != 2U || (frame->data[1] != 0U && frame->data[1] != node_id)) {
        return NMT_NO_RESET;
    }
    switch (frame->data[0]) {
    case COMMAND_START:
        *state = NMT_OPERATIONAL;
        break;
    case COMMAND_STOP:
        *state = NMT_STOPPED;
        break;
    case COMMAND_PRE_OPERATIONAL:
        *state = NMT_PRE_OPERATIONAL;
        break;
    case COMMAND_RESET_NODE:
        return NMT_RESET_NODE;
    case COMMAND_RESET_COMMUNICATION:
        return NMT_RESET_COMMUNICATION;
    default:
        break;
    }
    return NMT_NO_RESET;
}
