/**
 * Sums of node time that saturate: a timer that nobody resets stands still at its end, it never
 * wraps.
 */
#ifndef NODE_TIME_H
#define NODE_TIME_H

#include <stdint.h>

/** time_us + elapsed_us, at most UINT32_MAX. */
static inline uint32_t node_time_add(uint32_t time_us, uint32_t elapsed_us) {
    return elapsed_us > UINT32_MAX - time_us ? UINT32_MAX : time_us + elapsed_us;
}

/** Adds to a counter of object 2201h, which saturates as well. */
static inline void node_count(uint16_t *counter, uint32_t events) {
    const uint32_t sum = node_time_add(*counter, events);
    *counter = sum > UINT16_MAX ? UINT16_MAX : (uint16_t)sum;
}

#endif
