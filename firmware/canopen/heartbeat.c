#include "canopen/heartbeat.h"

#include "canopen/node_time.h"

static uint8_t watched_node(uint32_t time) {
    return (uint8_t)((time >> 16) & 0x7FU);
}

static uint32_t watched_us(uint32_t time) {
    return (time & 0xFFFFU) * 1000U;
}

bool heartbeat_due(uint16_t time_ms, uint32_t elapsed_us, heartbeat_producer_t *producer) {
    const uint32_t period_us = (uint32_t)time_ms * 1000U;
    producer->since_us = node_time_add(producer->since_us, elapsed_us);
    if (period_us == 0U || producer->since_us < period_us) {
        return false;
    }
    producer->since_us %= period_us;
    return true;
}

can_frame_t heartbeat_frame(uint8_t node_id, nmt_state_t state) {
    can_frame_t frame = {.id = (uint16_t)(HEARTBEAT_COB_ID + node_id), .len = 1};
    frame.data[0] = (uint8_t)state;
    return frame;
}

void heartbeat_receive(const uint32_t times[HEARTBEAT_CONSUMERS], const can_frame_t *frame,
                       heartbeat_consumer_t *consumer) {
    if (frame->len != 1U || frame->data[0] == (uint8_t)NMT_BOOT_UP) {
        return;
    }
    for (size_t i = 0; i < HEARTBEAT_CONSUMERS; i++) {
        if (watched_us(times[i]) != 0U && watched_node(times[i]) == (frame->id & 0x7FU)) {
            consumer->entries[i].watching = true;
            consumer->entries[i].since_us = 0;
        }
    }
}

void heartbeat_elapse(uint32_t elapsed_us, heartbeat_consumer_t *consumer) {
    for (size_t i = 0; i < HEARTBEAT_CONSUMERS; i++) {
        consumer->entries[i].since_us = node_time_add(consumer->entries[i].since_us, elapsed_us);
    }
}

uint8_t heartbeat_lost(const uint32_t times[HEARTBEAT_CONSUMERS], heartbeat_consumer_t *consumer) {
    for (size_t i = 0; i < HEARTBEAT_CONSUMERS; i++) {
        if (consumer->entries[i].watching &&
            consumer->entries[i].since_us >= watched_us(times[i])) {
            consumer->entries[i].watching = false;
            return watched_node(times[i]);
        }
    }
    return 0;
}
