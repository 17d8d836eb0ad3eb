/**
 * The joint loop's clock: TIM2, 84 MHz, whose update interrupt is the tick; 5 kHz while no SYNC
 * comes, in step with SYNC otherwise (tick_discipline.h).
 *
 * tick_timer_interrupt() and tick_timer_sync() must run at one interrupt priority, the highest of
 * this port: it is when SYNC came that is measured. The joint tick itself may run below it.
 */
#ifndef TICK_TIMER_H
#define TICK_TIMER_H

#include <stdbool.h>
#include <stdint.h>

#include "port/stm32f405/tick_discipline.h"

#define TICK_TIMER_COUNTS_PER_us 84U

typedef struct {
    tick_discipline_t discipline;
    bool sync_waits; /**< it came after the update that the tick's interrupt has not seen yet */
    uint32_t sync_count;
    uint8_t sync_joint_ticks; /**< J of it, 1..10 */
} tick_timer_t;

/** Limits in use: ticks of 100 us to 10 ms, 10 us after SYNC, corrected by 2 us a tick at most,
 * kept for 1 s without SYNC. */
extern const tick_discipline_config_t tick_timer_config;

/** Clock on, the first tick in 200 us. The interrupt is to be enabled by the caller. */
void tick_timer_start(tick_timer_t *timer);

/** In TIM2's interrupt. */
void tick_timer_interrupt(tick_timer_t *timer);

/** In the receive interrupt that brought the SYNC. joint_ticks: object 2100h:08, 1..10. */
void tick_timer_sync(uint8_t joint_ticks, tick_timer_t *timer);

#endif
