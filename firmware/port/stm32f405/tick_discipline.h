/**
 * Keeps the joint loop's timer in step with SYNC: how long each tick is to last. Pure; counts are
 * those of the timer.
 *
 * With SYNC there are J ticks in a SYNC period, and one of them comes lead_counts after the SYNC,
 * so that a command acts at once. The tick's length is the SYNC period through J, smoothed over
 * eight of them; a quarter of the distance from the right phase is made up for after each SYNC,
 * at most step_max_counts in one tick, so that the joint loop never sees a jump in time. Up to 15
 * SYNCs may be missing without losing step, and three that come at a strange time are passed over.
 * Without SYNC for hold_counts, or with one that gives a length outside the limits, ticks last
 * nominal_counts.
 *
 * The length that a tick gets is fixed one tick before it begins (the timer preloads it).
 */
#ifndef TICK_DISCIPLINE_H
#define TICK_DISCIPLINE_H

#include <stdbool.h>
#include <stdint.h>

/** All below 2^23, hold_counts below 2^29, and step_max_counts below a quarter of min_counts. */
typedef struct {
    uint32_t nominal_counts;  /**< length of a tick without SYNC */
    uint32_t min_counts;      /**< shortest tick with SYNC, before phase correction */
    uint32_t max_counts;      /**< longest, likewise */
    uint32_t lead_counts;     /**< a tick comes this long after the SYNC */
    uint32_t step_max_counts; /**< phase correction in one tick */
    uint32_t hold_counts;     /**< so long the length is kept while no SYNC comes */
} tick_discipline_config_t;

typedef struct {
    uint32_t running_counts; /**< length of the tick that runs */
    uint32_t next_counts;    /**< and of the one after it */
    uint32_t base_256;       /**< length without phase correction, 1/256 count */
    uint32_t rest_256;       /**< of the base, not given out yet */
    int32_t pending_counts;  /**< phase correction that is left */
    int32_t since_counts;    /**< from the last SYNC to the begin of the tick that runs */
    uint8_t strange;         /**< intervals in a row that did not fit */
    bool sync_seen;          /**< within hold_counts */
    bool locked;             /**< lengths come from SYNC */
} tick_discipline_t;

/** Two ticks of nominal length begin. */
void tick_discipline_start(const tick_discipline_config_t *config, tick_discipline_t *discipline);

/** A SYNC came count counts after the begin of the tick that runs. joint_ticks: J, 1..10. */
void tick_discipline_sync(const tick_discipline_config_t *config, uint32_t count,
                          uint8_t joint_ticks, tick_discipline_t *discipline);

/** The next tick has begun; returns the length of the one after it, for the timer's preload. */
uint32_t tick_discipline_tick(const tick_discipline_config_t *config,
                              tick_discipline_t *discipline);

#endif
