#include "cia402/homing.h"

#include "canopen/node_time.h"
#include "cia402/drive_state.h"

#define ATTAINED 0x1000U
#define ERROR 0x2000U
#define MICRO 1000000U

void homing_start(const homing_config_t *config, int32_t position_inc, homing_t *homing) {
    homing->phase = config->method == HOMING_HERE ? HOMING_ATTAINED : HOMING_SEARCHING;
    homing->target_inc = position_inc;
    homing->rest = 0;
    homing->since_us = 0;
}

static int32_t saturate(int64_t position) {
    return position > INT32_MAX ? INT32_MAX : position < INT32_MIN ? INT32_MIN : (int32_t)position;
}

void homing_step(const homing_config_t *config, int32_t position_inc, uint32_t elapsed_us,
                 homing_t *homing) {
    if (homing->phase != HOMING_SEARCHING) {
        return;
    }
    homing->since_us = node_time_add(homing->since_us, elapsed_us);
    if (homing->since_us >= config->time_out_us) {
        homing->phase = HOMING_FAILED;
        return;
    }
    const uint64_t moved = (uint64_t)config->speed_inc_s * elapsed_us + homing->rest;
    const int64_t way = (int64_t)(moved / MICRO);
    homing->rest = (uint32_t)(moved % MICRO);
    if (config->method == HOMING_INDEX_NEGATIVE) {
        const int64_t furthest = (int64_t)position_inc - (int64_t)config->lead_inc;
        const int64_t target = homing->target_inc - way;
        homing->target_inc = saturate(target < furthest ? furthest : target);
    } else {
        const int64_t furthest = (int64_t)position_inc + (int64_t)config->lead_inc;
        const int64_t target = homing->target_inc + way;
        homing->target_inc = saturate(target > furthest ? furthest : target);
    }
}

uint16_t homing_statusword(bool referenced, bool moving, const homing_t *homing) {
    const uint16_t at_rest = moving ? 0U : STATUSWORD_TARGET_REACHED;
    switch (homing->phase) {
    case HOMING_SEARCHING:
        return 0;
    case HOMING_ATTAINED:
        return (uint16_t)(ATTAINED | at_rest);
    case HOMING_FAILED:
        return (uint16_t)(ERROR | at_rest);
    case HOMING_INTERRUPTED:
        return STATUSWORD_TARGET_REACHED;
    case HOMING_NOT_STARTED:
    default:
        return (uint16_t)(STATUSWORD_TARGET_REACHED | (referenced ? ATTAINED : 0U));
    }
}
