/**
 * The node on a TCP port as SLCAN, in place of a board on a serial line: the same
 * port/slcan/slcan_node.c that the board runs, on this machine. For tests, and for clients that
 * speak SLCAN, such as python-can. In the free-running time base it steps each millisecond with an
 * encoder that stands still; in the stepped one RPDO4 brings tick and position.
 */
#ifndef SLCAN_SERVER_H
#define SLCAN_SERVER_H

#include <stdint.h>

#include "node/motor_node.h"

/** Listens on 127.0.0.1, port 0 = any free one, says "READY PORT" on standard output, and serves
 * one client after the other until SIGTERM or SIGINT. Returns the exit status: 0 or 3. */
int slcan_server(motor_node_config_t *config, uint16_t port);

#endif
