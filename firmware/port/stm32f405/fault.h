/**
 * Faults of the core: torque off first, then a crash record into RAM that outlives the reset, then
 * the reset (ARM DDI 0403E, B1.5; RM0090, section 6.1.1).
 *
 * A record is valid when its magic and checksum fit: at power-on RAM holds anything. The handlers
 * run on a stack of their own, since a fault may mean that the other one has overflowed into its
 * guard, a region of the memory protection unit without access.
 */
#ifndef FAULT_H
#define FAULT_H

#include <stdbool.h>
#include <stdint.h>

#include "node/crash_record.h"

/** Turns on the guard of the stack and the separate fault exceptions. */
void fault_init(void);

/** The record that a reset has left. *record: all zero when there is none. True when it is of the
 * last reset and not yet taken: the next call gives it again, but as an old one. */
bool fault_take_record(crash_record_t *record);

/** Keeps a record without registers of the core, e.g. of a reset by the hardware watchdog. */
void fault_keep(crash_cause_t cause);

/** Torque off, record, reset. frame: what the core has stacked at exception entry. */
_Noreturn void fault_end(crash_cause_t cause, const uint32_t *frame);

/** Reads a word that may not be there, at an address that is a multiple of 4 bytes; false when the
 * bus answers with a fault. */
bool fault_probe(uint32_t address, uint32_t *value);

/** Entry of all fault exceptions and of interrupts without a handler. */
void fault_entry(void);

#endif
