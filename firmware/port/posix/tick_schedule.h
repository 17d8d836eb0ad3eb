/**
 * When a node in the free-running time base takes its joint ticks: with SYNC, one at the SYNC and
 * J - 1 more evenly over its period; without, one each millisecond.
 *
 * Times in ns of a clock that never goes back. The period is that between the last two SYNCs; when
 * one is late by half a period, the node goes on by itself.
 */
#ifndef TICK_SCHEDULE_H
#define TICK_SCHEDULE_H

#include <stdint.h>

#define TICK_SCHEDULE_FREE_ns 1000000
#define TICK_SCHEDULE_PERIOD_MAX_ns 1000000000

typedef struct {
    int64_t sync_ns;   /**< of the last SYNC */
    int64_t period_ns; /**< 0 = no two SYNCs yet */
    int64_t next_ns;   /**< of the next tick, unless a SYNC comes before it */
    uint8_t ticks;     /**< since the last SYNC, itself included */
} tick_schedule_t;

/** Begins without SYNC: the first tick is due at once. */
void tick_schedule_start(int64_t now_ns, tick_schedule_t *schedule);

/** A SYNC has come: its tick is taken now. joint_ticks: J, 1..10. */
void tick_schedule_sync(int64_t now_ns, uint8_t joint_ticks, tick_schedule_t *schedule);

/** The tick that was due at next_ns is taken. joint_ticks: J, 1..10. */
void tick_schedule_tick(int64_t now_ns, uint8_t joint_ticks, tick_schedule_t *schedule);

#endif
