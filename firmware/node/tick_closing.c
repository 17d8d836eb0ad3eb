#include "node/tick_closing.h"

#define RPDO4_TICK 4U /* byte of the tick number */
#define PERIOD_DEFAULT_us 1000U
#define ELAPSED_MAX_us 1000000U

static bool is_own_rpdo4(const motor_node_t *node, const can_frame_t *frame) {
    return node->node_id != LSS_UNCONFIGURED &&
           frame->id == OD_RPDO4_COB_ID + (uint32_t)node->node_id && frame->len > RPDO4_TICK;
}

tick_closing_event_t tick_closing_receive(const motor_node_t *node, const can_frame_t *frame,
                                          tick_closing_t *closing, uint32_t *elapsed_us) {
    if (node->od.time_base == 0U) {
        closing->known = false;
        return TICK_GOES_ON;
    }
    if (!is_own_rpdo4(node, frame)) {
        return TICK_GOES_ON;
    }
    const uint8_t tick = frame->data[RPDO4_TICK];
    if (closing->known && tick == closing->tick) {
        return TICK_REPEATED;
    }
    const uint32_t set_us = node->od.communication_cycle_period;
    const uint32_t period_us = set_us != 0U ? set_us : PERIOD_DEFAULT_us;
    const uint32_t ticks = closing->known ? (uint32_t)(uint8_t)(tick - closing->tick) : 1U;
    *elapsed_us = period_us > ELAPSED_MAX_us / ticks ? ELAPSED_MAX_us : ticks * period_us;
    closing->tick = tick;
    closing->known = true;
    return TICK_CLOSED;
}
