/**
 * The firmware alone on a CAN bus, on the wall clock: anyone's client is its master, and a
 * simulated joint (simulated_joint.h) is its motor and encoder. In the stepped time base its ticks
 * are those of RPDO4 (node/tick_closing.h), not of the wall clock.
 */
#ifndef FREE_RUNNING_H
#define FREE_RUNNING_H

#include <stdbool.h>
#include <stdint.h>

#include "port/posix/simulated_joint.h"

typedef struct {
    uint8_t node_id; /**< 1..127, or 255: none until LSS gives one */
    uint32_t serial_number;
    const char
        *parameters;       /**< file that stands for the non-volatile memory; NULL: there is none */
    bool referenced;       /**< an absolute encoder: mode -1 needs no homing */
    bool supervisor_reset; /**< starts as after a watchdog reset */
    bool clock_fallback;   /**< says that its clock is the internal oscillator */
    const char *can;       /**< name of the interface */
    int16_t temperature_dC;
    simulated_joint_config_t joint;
} free_running_options_t;

/** Runs until SIGINT or SIGTERM (stop_signal.h). Returns 0, or 3 with the reason on stderr. */
int free_running(const free_running_options_t *options);

#endif
