/**
 * Node-id from seven switches to ground on PC2 (1) to PC8 (64): closed counts. None closed: no
 * node-id, the node waits for LSS.
 */
#ifndef DIP_SWITCH_H
#define DIP_SWITCH_H

#include <stdint.h>

/**
 * Configures the pins and reads them until 256 readings in a row agree (at least 15 us, in which
 * the pull-ups charge the lines), 4096 at most. Returns 1..127, or LSS_UNCONFIGURED when none is
 * closed, when the readings do not settle, or when the port does not keep its configuration
 * (emulation).
 */
uint8_t dip_switch_read(void);

#endif
