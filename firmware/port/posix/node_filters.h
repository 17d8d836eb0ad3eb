/**
 * The accept rule of a motor node as SocketCAN filters: what motor_node_accepts() says, in the form
 * that the kernel takes.
 */
#ifndef NODE_FILTERS_H
#define NODE_FILTERS_H

#include "port/posix/can_socket.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NODE_FILTERS_COUNT 11U

/** Fills filters for node_id 1..127 or 255 (LSS alone). They also pass what the node itself sends,
 * which a socket never receives from itself. The last one also passes 700h, which nobody sends. */
void node_filters(uint8_t node_id, can_socket_filter_t filters[NODE_FILTERS_COUNT]);

#ifdef __cplusplus
}
#endif

#endif
