/**
 * A SocketCAN raw socket with kernel-side filters, batched calls and counted losses.
 *
 * Waits are bounded by the timeout that the caller names; a full transmit queue is back-pressure
 * (waited for, counted), never a silent loss. Source: Linux Documentation/networking/can.rst.
 */
#ifndef CAN_SOCKET_H
#define CAN_SOCKET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Most frames that one call moves. */
#define CAN_SOCKET_BATCH 64

typedef struct {
    int fd;
    uint32_t dropped;       /**< frames that the kernel dropped for want of buffer (SO_RXQ_OVFL) */
    uint32_t error_frames;  /**< error frames seen; they are no data and are passed over */
    bool bus_off;           /**< the controller has left the bus and is not back yet */
    uint32_t back_pressure; /**< times that the transmit queue was full */
} can_socket_t;

/** A filter as of SocketCAN: a frame passes when (id & mask) == (match & mask). */
typedef struct {
    uint16_t match;
    uint16_t mask;
} can_socket_filter_t;

/** Opens the socket on an interface; filters may be NULL (all frames). False: errno says why. */
bool can_socket_open(can_socket_t *can, const char *interface, const can_socket_filter_t *filters,
                     size_t filter_count);
/** Replaces the filters. False: errno says why. */
bool can_socket_set_filters(can_socket_t *can, const can_socket_filter_t *filters,
                            size_t filter_count);
void can_socket_close(can_socket_t *can);

/** Sends count (0..CAN_SOCKET_BATCH) frames in order. False after timeout_ms without room or on an
 * error (errno). */
bool can_socket_send(can_socket_t *can, const can_frame_t *frames, size_t count, int timeout_ms);

/** Receives exactly count (0..CAN_SOCKET_BATCH) frames; returns how many came before timeout_ms of
 * silence, or before a signal. */
size_t can_socket_receive(can_socket_t *can, can_frame_t *frames, size_t count, int timeout_ms);

#ifdef __cplusplus
}
#endif

#endif
