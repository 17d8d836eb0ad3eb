#include "cia402/drive_state.h"

#define FAULT_RESET 0x0080U

typedef enum {
    COMMAND_NONE,
    COMMAND_DISABLE_VOLTAGE,
    COMMAND_QUICK_STOP,
    COMMAND_SHUTDOWN,
    COMMAND_SWITCH_ON, /* in operation enabled: disable operation */
    COMMAND_ENABLE_OPERATION
} command_t;

/* CiA 402-2, 6.4: bits 7, 3, 2, 1, 0 of the controlword. */
static command_t command_of(uint16_t controlword) {
    if ((controlword & FAULT_RESET) != 0U) {
        return COMMAND_NONE;
    }
    if ((controlword & 0x02U) == 0U) {
        return COMMAND_DISABLE_VOLTAGE;
    }
    if ((controlword & 0x04U) == 0U) {
        return COMMAND_QUICK_STOP;
    }
    if ((controlword & 0x01U) == 0U) {
        return COMMAND_SHUTDOWN;
    }
    return (controlword & 0x08U) == 0U ? COMMAND_SWITCH_ON : COMMAND_ENABLE_OPERATION;
}

static void go(drive_state_t state, drive_t *drive) {
    drive->state = state;
    drive->next = state;
}

/** Leaves for next at once, or over a ramp during which the drive is in state during. */
static drive_result_t leave(bool ramp, drive_state_t during, drive_state_t next, drive_t *drive) {
    if (!ramp) {
        go(next, drive);
        return DRIVE_DONE;
    }
    drive->state = during;
    drive->next = next;
    return DRIVE_STOPPING;
}

static drive_result_t enable(bool may_enable, drive_t *drive) {
    if (!may_enable) {
        return DRIVE_ENABLE_REFUSED;
    }
    go(DRIVE_OPERATION_ENABLED, drive);
    return DRIVE_ENABLED;
}

void drive_init(drive_t *drive) {
    go(DRIVE_NOT_READY_TO_SWITCH_ON, drive);
    drive->controlword = 0;
    go(DRIVE_SWITCH_ON_DISABLED, drive);
}

drive_result_t drive_quick_stop(const drive_options_t *options, drive_t *drive) {
    const drive_state_t next =
        options->quick_stop >= 5 ? DRIVE_QUICK_STOP_ACTIVE : DRIVE_SWITCH_ON_DISABLED;
    return leave(options->quick_stop != 0, DRIVE_QUICK_STOP_ACTIVE, next, drive);
}

static drive_result_t in_ready_to_switch_on(command_t command, bool may_enable, drive_t *drive) {
    switch (command) {
    case COMMAND_DISABLE_VOLTAGE:
    case COMMAND_QUICK_STOP:
        go(DRIVE_SWITCH_ON_DISABLED, drive);
        return DRIVE_DONE;
    case COMMAND_SWITCH_ON:
        go(DRIVE_SWITCHED_ON, drive);
        return DRIVE_DONE;
    case COMMAND_ENABLE_OPERATION: /* transitions 3 and 4 in one */
        go(DRIVE_SWITCHED_ON, drive);
        return enable(may_enable, drive);
    case COMMAND_NONE:
    case COMMAND_SHUTDOWN:
    default:
        return DRIVE_DONE;
    }
}

static drive_result_t in_switched_on(command_t command, bool may_enable, drive_t *drive) {
    switch (command) {
    case COMMAND_DISABLE_VOLTAGE:
    case COMMAND_QUICK_STOP:
        go(DRIVE_SWITCH_ON_DISABLED, drive);
        return DRIVE_DONE;
    case COMMAND_SHUTDOWN:
        go(DRIVE_READY_TO_SWITCH_ON, drive);
        return DRIVE_DONE;
    case COMMAND_ENABLE_OPERATION:
        return enable(may_enable, drive);
    case COMMAND_NONE:
    case COMMAND_SWITCH_ON:
    default:
        return DRIVE_DONE;
    }
}

static drive_result_t in_operation_enabled(const drive_options_t *options, command_t command,
                                           drive_t *drive) {
    const bool already_leaving = drive->next != drive->state;
    switch (command) {
    case COMMAND_DISABLE_VOLTAGE:
        go(DRIVE_SWITCH_ON_DISABLED, drive);
        return DRIVE_DONE;
    case COMMAND_QUICK_STOP:
        return drive_quick_stop(options, drive);
    case COMMAND_SHUTDOWN:
        return already_leaving ? DRIVE_DONE
                               : leave(options->shutdown != 0, DRIVE_OPERATION_ENABLED,
                                       DRIVE_READY_TO_SWITCH_ON, drive);
    case COMMAND_SWITCH_ON:
        return already_leaving ? DRIVE_DONE
                               : leave(options->disable_operation != 0, DRIVE_OPERATION_ENABLED,
                                       DRIVE_SWITCHED_ON, drive);
    case COMMAND_NONE:
    case COMMAND_ENABLE_OPERATION:
    default:
        return DRIVE_DONE;
    }
}

static drive_result_t in_quick_stop_active(const drive_options_t *options, command_t command,
                                           bool may_enable, drive_t *drive) {
    if (command == COMMAND_DISABLE_VOLTAGE) {
        go(DRIVE_SWITCH_ON_DISABLED, drive);
    } else if (command == COMMAND_ENABLE_OPERATION && options->quick_stop >= 5) {
        return enable(may_enable, drive);
    }
    return DRIVE_DONE;
}

drive_result_t drive_command(const drive_options_t *options, bool may_enable, uint16_t controlword,
                             drive_t *drive) {
    const command_t command = command_of(controlword);
    const bool reset =
        (controlword & FAULT_RESET) != 0U && (drive->controlword & FAULT_RESET) == 0U;
    drive->controlword = controlword;
    switch (drive->state) {
    case DRIVE_SWITCH_ON_DISABLED:
        if (command == COMMAND_SHUTDOWN) {
            go(DRIVE_READY_TO_SWITCH_ON, drive);
        }
        return DRIVE_DONE;
    case DRIVE_READY_TO_SWITCH_ON:
        return in_ready_to_switch_on(command, may_enable, drive);
    case DRIVE_SWITCHED_ON:
        return in_switched_on(command, may_enable, drive);
    case DRIVE_OPERATION_ENABLED:
        return in_operation_enabled(options, command, drive);
    case DRIVE_QUICK_STOP_ACTIVE:
        return in_quick_stop_active(options, command, may_enable, drive);
    case DRIVE_FAULT:
        if (reset) {
            go(DRIVE_SWITCH_ON_DISABLED, drive);
            return DRIVE_FAULT_RESET;
        }
        return DRIVE_DONE;
    case DRIVE_NOT_READY_TO_SWITCH_ON:
    case DRIVE_FAULT_REACTION_ACTIVE:
    default:
        return DRIVE_DONE;
    }
}

drive_result_t drive_fault(const drive_options_t *options, bool ramp, drive_t *drive) {
    const bool was_reacting = drive->state == DRIVE_FAULT_REACTION_ACTIVE;
    if (drive->state == DRIVE_FAULT || (was_reacting && ramp)) {
        return DRIVE_DONE; /* a ramp under way goes on */
    }
    const bool can_ramp = ramp && drive_has_output(drive) && options->fault_reaction != 0;
    return leave(can_ramp, DRIVE_FAULT_REACTION_ACTIVE, DRIVE_FAULT, drive);
}

void drive_bound_is_zero(drive_t *drive) {
    go(drive->next, drive);
}

bool drive_has_output(const drive_t *drive) {
    return drive->state == DRIVE_OPERATION_ENABLED || drive->state == DRIVE_QUICK_STOP_ACTIVE ||
           drive->state == DRIVE_FAULT_REACTION_ACTIVE;
}

bool drive_wants_output(const drive_t *drive) {
    return drive->state == DRIVE_OPERATION_ENABLED && drive->next == drive->state;
}

uint16_t drive_statusword(const drive_t *drive) {
    switch (drive->state) {
    case DRIVE_SWITCH_ON_DISABLED:
        return 0x0040U | STATUSWORD_QUICK_STOP;
    case DRIVE_READY_TO_SWITCH_ON:
        return 0x0001U | STATUSWORD_QUICK_STOP;
    case DRIVE_SWITCHED_ON:
        return 0x0003U | STATUSWORD_QUICK_STOP;
    case DRIVE_OPERATION_ENABLED:
        return 0x0007U | STATUSWORD_QUICK_STOP;
    case DRIVE_QUICK_STOP_ACTIVE:
        return 0x0007U;
    case DRIVE_FAULT_REACTION_ACTIVE:
        return 0x000FU | STATUSWORD_QUICK_STOP;
    case DRIVE_FAULT:
        return 0x0008U | STATUSWORD_QUICK_STOP;
    case DRIVE_NOT_READY_TO_SWITCH_ON:
    default:
        return 0x0000U;
    }
}
