/**
 * The node's clock and the supervisor's beat, both from the core's SysTick (ARM DDI 0403E, B3.3).
 *
 * The clock counts core cycles in whole beats and what has passed of the one under way; it never
 * goes back.
 */
#ifndef TIME_BASE_H
#define TIME_BASE_H

#include <stdint.h>

/** core_MHz: 16 to 168. beat_us: 100 to 10000. */
void time_base_start(uint32_t core_MHz, uint32_t beat_us);

/** Time since start, modulo 2^32: differences below one hour are what it is for. */
uint32_t time_base_now_us(void);

/** A beat has ended: from SysTick's handler. */
void time_base_expired(void);

#endif
