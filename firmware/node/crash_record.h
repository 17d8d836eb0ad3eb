/**
 * Why a device was reset, as far as its port could keep it over the reset: object 2203h.
 *
 * The registers are those of an ARMv7-M core (ARM DDI 0403E, B1.5.6 and B3.2.15 to B3.2.18), 0
 * where the cause gives none.
 */
#ifndef CRASH_RECORD_H
#define CRASH_RECORD_H

#include <stdint.h>

/** Sub-index 1 of 2203h, and source of EMCY 6010h. */
typedef enum {
    CRASH_NONE = 0,
    CRASH_HARD_FAULT = 1,
    CRASH_MEMORY_FAULT = 2,
    CRASH_BUS_FAULT = 3,
    CRASH_USAGE_FAULT = 4,
    CRASH_STACK_OVERFLOW = 5, /**< guard region hit */
    CRASH_SUPERVISOR = 6,     /**< joint ticks or main loop have stopped */
    CRASH_WATCHDOG = 7,       /**< hardware watchdog: no registers are known */
    CRASH_IMAGE = 8,          /**< the image's checksum is wrong: not a reset */
    CRASH_UNEXPECTED = 9      /**< interrupt without a handler, clock failure */
} crash_cause_t;

typedef struct {
    crash_cause_t cause;
    uint32_t program_counter;
    uint32_t link_register;
    uint32_t program_status;    /**< xPSR */
    uint32_t fault_status;      /**< CFSR */
    uint32_t hard_fault_status; /**< HFSR */
    uint32_t fault_address;     /**< MMFAR or BFAR, 0 when not valid */
    uint16_t count;             /**< such resets since power-on */
} crash_record_t;

#endif
