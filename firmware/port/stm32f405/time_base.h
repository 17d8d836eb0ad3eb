/**
 * The node's clock and alarm, both from the core's SysTick (ARM DDI 0403E, B3.3): time in ns since
 * start that never goes back, and one expiry at a time, at most 10 ms away.
 *
 * Starting SysTick anew loses the few cycles that it takes, less than 0.1 us a tick; SYNC takes
 * that out again. Called with interrupts blocked or from one priority only, but time_base_now_ns.
 */
#ifndef TIME_BASE_H
#define TIME_BASE_H

#include <stdint.h>

#define TIME_BASE_MAX_ns 10000000

/** core_MHz: clock of the core, 16 to 168. The first expiry is one TIME_BASE_MAX_ns away. */
void time_base_init(uint32_t core_MHz);

int64_t time_base_now_ns(void);

/** The next expiry is at this time, or as soon as possible, or after TIME_BASE_MAX_ns. */
void time_base_alarm(int64_t at_ns);

/** From the handler of SysTick: the next expiry is TIME_BASE_MAX_ns away until time_base_alarm. */
void time_base_expired(void);

#endif
