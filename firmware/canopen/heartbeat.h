/**
 * Heartbeat producer and consumer (CiA 301, 7.2.8.3.2.2), in node time.
 *
 * A consumer entry starts to watch at the first heartbeat of its node; when none comes for the
 * entry's time it reports once, and watches again from the next one on. A boot-up message is no
 * heartbeat.
 */
#ifndef HEARTBEAT_H
#define HEARTBEAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"
#include "canopen/nmt.h"

#define HEARTBEAT_COB_ID 0x700U
#define HEARTBEAT_CONSUMERS 4U

typedef struct {
    uint32_t since_us;
} heartbeat_producer_t;

typedef struct {
    struct {
        bool watching;
        uint32_t since_us;
    } entries[HEARTBEAT_CONSUMERS];
} heartbeat_consumer_t;

/** True when a heartbeat is due; time_ms: 1017h, 0 = never. */
bool heartbeat_due(uint16_t time_ms, uint32_t elapsed_us, heartbeat_producer_t *producer);

/** The heartbeat, or with NMT_BOOT_UP the boot-up message, of a node. */
can_frame_t heartbeat_frame(uint8_t node_id, nmt_state_t state);

/** Takes in one frame with COB-ID 701h..77Fh. times: the entries of 1016h. */
void heartbeat_receive(const uint32_t times[HEARTBEAT_CONSUMERS], const can_frame_t *frame,
                       heartbeat_consumer_t *consumer);

/** Lets node time pass. */
void heartbeat_elapse(uint32_t elapsed_us, heartbeat_consumer_t *consumer);

/** Returns the id of a node whose heartbeat has just been lost, 0 = none. */
uint8_t heartbeat_lost(const uint32_t times[HEARTBEAT_CONSUMERS], heartbeat_consumer_t *consumer);

#endif
