#include "canopen/pdo.h"

#include "canopen/node_time.h"

rpdo_result_t rpdo_receive(uint8_t length, const can_frame_t *frame, rpdo_t *rpdo) {
    rpdo_result_t result = {.length = PDO_LENGTH_OK};
    if (frame->len < length) {
        result.length = PDO_TOO_SHORT;
    } else if (frame->len > length) {
        result.length = PDO_TOO_LONG;
    }
    result.report = result.length != PDO_LENGTH_OK && result.length != rpdo->last;
    rpdo->last = result.length;
    return result;
}

bool tpdo_event_due(uint32_t inhibit_us, uint32_t event_us, uint32_t elapsed_us, bool changed,
                    tpdo_event_t *tpdo) {
    tpdo->since_us = node_time_add(tpdo->since_us, elapsed_us);
    tpdo->changed = tpdo->changed || changed;
    const bool due = (tpdo->changed && tpdo->since_us >= inhibit_us) ||
                     (event_us != 0U && tpdo->since_us >= event_us);
    if (due) {
        tpdo->since_us = 0;
        tpdo->changed = false;
    }
    return due;
}
