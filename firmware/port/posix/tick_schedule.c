#include "port/posix/tick_schedule.h"

void tick_schedule_start(int64_t now_ns, tick_schedule_t *schedule) {
    *schedule = (tick_schedule_t){.next_ns = now_ns};
}

/** After the last of the J ticks the next one is the SYNC's; half a period of grace for it. */
static void plan(uint8_t joint_ticks, tick_schedule_t *schedule) {
    const int64_t period_ns = schedule->period_ns;
    schedule->next_ns = schedule->ticks < joint_ticks
                            ? schedule->sync_ns + period_ns * schedule->ticks / joint_ticks
                            : schedule->sync_ns + period_ns + period_ns / 2;
}

void tick_schedule_sync(int64_t now_ns, uint8_t joint_ticks, tick_schedule_t *schedule) {
    const int64_t period_ns = now_ns - schedule->sync_ns;
    const int periodic =
        schedule->sync_ns != 0 && period_ns > 0 && period_ns <= TICK_SCHEDULE_PERIOD_MAX_ns;
    schedule->period_ns = periodic ? period_ns : 0;
    schedule->sync_ns = now_ns;
    schedule->ticks = 1;
    if (periodic) {
        plan(joint_ticks, schedule);
    } else {
        schedule->next_ns = now_ns + TICK_SCHEDULE_FREE_ns;
    }
}

void tick_schedule_tick(int64_t now_ns, uint8_t joint_ticks, tick_schedule_t *schedule) {
    if (schedule->period_ns != 0 && schedule->ticks < joint_ticks) {
        schedule->ticks++;
        plan(joint_ticks, schedule);
        return;
    }
    schedule->period_ns = 0;
    schedule->next_ns += TICK_SCHEDULE_FREE_ns;
    if (schedule->next_ns <= now_ns) { /* the process was held up: no burst of ticks */
        schedule->next_ns = now_ns + TICK_SCHEDULE_FREE_ns;
    }
}
