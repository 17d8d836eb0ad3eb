/**
 * Drive state machine of CiA 402-2 (clause 6): states, transitions 0 to 16, and what the option
 * codes 605Ah to 605Eh make of them.
 *
 * Whoever drives it ramps the output bound: drive_wants_output says in which direction, and
 * drive_bound_is_zero reports that it has arrived. A controlword is a command that is carried out
 * once, when it comes; only a rising edge of bit 7 resets a fault.
 */
#ifndef DRIVE_STATE_H
#define DRIVE_STATE_H

#include <stdbool.h>
#include <stdint.h>

typedef enum {
    DRIVE_NOT_READY_TO_SWITCH_ON,
    DRIVE_SWITCH_ON_DISABLED,
    DRIVE_READY_TO_SWITCH_ON,
    DRIVE_SWITCHED_ON,
    DRIVE_OPERATION_ENABLED,
    DRIVE_QUICK_STOP_ACTIVE,
    DRIVE_FAULT_REACTION_ACTIVE,
    DRIVE_FAULT
} drive_state_t;

/** Option codes, as their objects define them. */
typedef struct {
    int16_t quick_stop; /**< 605Ah: 0 torque off; 1, 2 ramp, then off; 5, 6 ramp, then stay */
    int16_t shutdown;   /**< 605Bh: 0 torque off; 1 ramp first */
    int16_t disable_operation; /**< 605Ch: 0 torque off; 1 ramp first */
    int16_t fault_reaction;    /**< 605Eh: 0 torque off; 1, 2 ramp first */
} drive_options_t;

typedef struct {
    drive_state_t state;
    drive_state_t next; /**< follows when the output bound is zero; the same as state when none */
    uint16_t controlword;
} drive_t;

/** What became of a controlword. */
typedef enum {
    DRIVE_DONE,           /**< nothing, or a transition without further ado */
    DRIVE_ENABLED,        /**< operation has just been enabled: start from a bound of zero */
    DRIVE_ENABLE_REFUSED, /**< enabling was asked for while may_enable was false */
    DRIVE_STOPPING,       /**< the bound is to be ramped to zero, holding the measured angle */
    DRIVE_FAULT_RESET
} drive_result_t;

#define CONTROLWORD_HALT 0x0100U

#define STATUSWORD_VOLTAGE_ENABLED 0x0010U
#define STATUSWORD_QUICK_STOP 0x0020U /**< 0 while a quick stop is active */
#define STATUSWORD_WARNING 0x0080U
#define STATUSWORD_REMOTE 0x0200U
#define STATUSWORD_TARGET_REACHED 0x0400U /**< mode -1: |e| <= q_a */
#define STATUSWORD_INTERNAL_LIMIT 0x0800U /**< any limit reason */
#define STATUSWORD_FOLLOWS 0x1000U        /**< the command is followed */
#define STATUSWORD_CONVERGENCE 0x4000U    /**< manufacturer-specific */
#define STATUSWORD_REFERENCED 0x8000U     /**< manufacturer-specific */

/** Transitions 0 and 1. */
void drive_init(drive_t *drive);

/** Carries out one controlword (6040h). */
drive_result_t drive_command(const drive_options_t *options, bool may_enable, uint16_t controlword,
                             drive_t *drive);

/** Transition 11 from within; operation must be enabled. */
drive_result_t drive_quick_stop(const drive_options_t *options, drive_t *drive);

/** Transition 13. ramp = false: torque off at once, whatever 605Eh says. */
drive_result_t drive_fault(const drive_options_t *options, bool ramp, drive_t *drive);

/** The output bound has come to zero: carries out what waits for it. */
void drive_bound_is_zero(drive_t *drive);

/** The power stage is on. */
bool drive_has_output(const drive_t *drive);

/** Operation is enabled and not about to end: the bound goes up. */
bool drive_wants_output(const drive_t *drive);

/** Bits 0 to 3, 5 and 6 of the statusword. */
uint16_t drive_statusword(const drive_t *drive);

#endif
