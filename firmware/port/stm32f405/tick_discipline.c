#include "port/stm32f405/tick_discipline.h"

enum {
    PER_COUNT = 256,
    SMOOTHING = 8,
    PHASE_SHARE = 4,
    MISSING_MAX = 16, /* SYNC periods between two SYNCs */
    TOLERANCE = 16,   /* a length within 1/16 is the same SYNC's */
    STRANGE_MAX = 3,  /* intervals that are not, before they are believed */
    SINCE_MAX_counts = 0x40000000
};

static int32_t limit(int32_t value, int32_t bound) {
    return value > bound ? bound : (value < -bound ? -bound : value);
}

void tick_discipline_start(const tick_discipline_config_t *config, tick_discipline_t *discipline) {
    *discipline = (tick_discipline_t){.running_counts = config->nominal_counts,
                                      .next_counts = config->nominal_counts,
                                      .base_256 = config->nominal_counts * PER_COUNT};
}

/** Smooths the length with the one of this interval; false when it is none of the SYNC followed. */
static bool follow(uint64_t interval_256, uint8_t joint_ticks, tick_discipline_t *discipline) {
    const uint64_t expected_256 = (uint64_t)discipline->base_256 * joint_ticks;
    const uint64_t periods = (interval_256 + expected_256 / 2U) / expected_256;
    if (periods < 1U || periods > MISSING_MAX) {
        return false;
    }
    const int64_t change_256 =
        (int64_t)(interval_256 / (periods * joint_ticks)) - (int64_t)discipline->base_256;
    const int64_t tolerance_256 = (int64_t)(discipline->base_256 / TOLERANCE);
    if (change_256 > tolerance_256 || change_256 < -tolerance_256) {
        return false;
    }
    discipline->base_256 = (uint32_t)((int64_t)discipline->base_256 + change_256 / SMOOTHING);
    return true;
}

/** Takes the length of this interval as it is; false when it is outside the limits. */
static bool adopt(const tick_discipline_config_t *config, uint64_t interval_256,
                  uint8_t joint_ticks, tick_discipline_t *discipline) {
    const uint64_t length_256 = interval_256 / joint_ticks;
    if (length_256 < (uint64_t)config->min_counts * PER_COUNT ||
        length_256 > (uint64_t)config->max_counts * PER_COUNT) {
        return false;
    }
    discipline->base_256 = (uint32_t)length_256;
    return true;
}

static void free_run(const tick_discipline_config_t *config, tick_discipline_t *discipline) {
    discipline->locked = false;
    discipline->strange = 0;
    discipline->pending_counts = 0;
    discipline->base_256 = config->nominal_counts * PER_COUNT;
}

void tick_discipline_sync(const tick_discipline_config_t *config, uint32_t count,
                          uint8_t joint_ticks, tick_discipline_t *discipline) {
    const int32_t interval_counts = discipline->since_counts + (int32_t)count;
    const bool second = discipline->sync_seen && interval_counts > 0;
    discipline->sync_seen = true;
    discipline->since_counts = -(int32_t)count;
    if (!second) {
        return;
    }
    const uint64_t interval_256 = (uint64_t)interval_counts * PER_COUNT;
    if (!discipline->locked || !follow(interval_256, joint_ticks, discipline)) {
        if (discipline->locked && discipline->strange < STRANGE_MAX) {
            discipline->strange++;
            return;
        }
        if (!adopt(config, interval_256, joint_ticks, discipline)) {
            free_run(config, discipline);
            return;
        }
    }
    discipline->strange = 0;
    discipline->locked = true;
    const int32_t base_counts = (int32_t)(discipline->base_256 / PER_COUNT);
    /* How much too late the tick after the next comes, were nothing corrected any more; ticks are
     * alike, so the nearest one counts. */
    int32_t late_counts = (int32_t)discipline->running_counts - (int32_t)count +
                          (int32_t)discipline->next_counts - base_counts -
                          (int32_t)config->lead_counts;
    late_counts %= base_counts;
    if (late_counts > base_counts / 2) {
        late_counts -= base_counts;
    } else if (late_counts < -(base_counts / 2)) {
        late_counts += base_counts;
    } else {
        /* the nearest already */
    }
    discipline->pending_counts = -(late_counts / PHASE_SHARE);
}

uint32_t tick_discipline_tick(const tick_discipline_config_t *config,
                              tick_discipline_t *discipline) {
    if (discipline->since_counts < SINCE_MAX_counts) {
        discipline->since_counts += (int32_t)discipline->running_counts;
    }
    if (discipline->since_counts > (int32_t)config->hold_counts) {
        discipline->sync_seen = false;
        free_run(config, discipline);
    }
    discipline->running_counts = discipline->next_counts;
    const int32_t step_counts = limit(discipline->pending_counts, (int32_t)config->step_max_counts);
    discipline->pending_counts -= step_counts;
    const uint32_t length_256 = discipline->base_256 + discipline->rest_256;
    discipline->rest_256 = length_256 % PER_COUNT;
    discipline->next_counts = (uint32_t)((int32_t)(length_256 / PER_COUNT) + step_counts);
    return discipline->next_counts;
}
