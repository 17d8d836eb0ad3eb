/**
 * CAN at 1 Mbit/s by the chip's controller bxCAN (RM0090 section 32), frames of 11-bit identifiers.
 *
 * Bit time: APB1 42 MHz / 2 = 21 quanta; 1 + 16 before the sample point, 4 after it: it lies at
 * 81.0 %. Resynchronisation up to 4 quanta.
 *
 * Receiving. Hardware filters let through what motor_node_accepts() says: bxcan_filter() is made
 * from that rule at run time. SYNC and the node's RPDO1 and RPDO4 go to FIFO 0, everything else to
 * FIFO 1, so that a burst of heartbeats cannot push out a command. Both interrupts put their frames
 * into one ring, which the joint tick empties; a FIFO or a ring that is full loses the newest
 * frame, counted. Within a FIFO the order of arrival is kept; between the two it is kept as long as
 * the interrupts are served within the shortest frame's 47 us.
 *
 * Sending. Frames wait in a list sorted by identifier, equal ones in order of their arrival. The
 * three mailboxes hold the most urgent; never two of one identifier, because the controller sends
 * equal ones by number of the mailbox. When a more urgent frame comes while all three are taken,
 * the least urgent is called back, unless it is on the wire already.
 *
 * Bus-off. The controller comes back by itself after 128 times 11 recessive bits (ABOM). What was
 * to be sent is thrown away, counted: set values and states would be old by then.
 *
 * Contexts: bxcan_receive_interrupt() in the interrupts of both FIFOs, at one priority.
 * bxcan_send(), bxcan_transmit() and bxcan_poll() at one priority, that of the joint tick.
 * bxcan_receive() there as well.
 */
#ifndef BXCAN_H
#define BXCAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"

/** Frames that the ring holds; a power of 2. */
#define BXCAN_RING_SIZE 32U
/** Frames that wait for a mailbox. */
#define BXCAN_WAITING_MAX 24U
#define BXCAN_MAILBOXES 3U
/** Receive FIFO of SYNC and the cyclic commands, and that of the rest. */
#define BXCAN_FIFO_CYCLIC 0U
#define BXCAN_FIFO_OTHER 1U

typedef enum {
    BXCAN_STARTED,
    BXCAN_WAITS_FOR_BUS, /**< started, but the bus has not been quiet for 11 bits yet */
    BXCAN_ABSENT         /**< the controller does not answer: there is none (emulation) */
} bxcan_start_t;

/** All counters saturate. */
typedef struct {
    uint32_t received;         /**< frames put into the ring */
    uint32_t sent;             /**< frames that another node has acknowledged */
    uint32_t fifo_overruns[2]; /**< times that a FIFO lost a frame; one or more each */
    uint32_t ring_overruns;    /**< frames that the tick did not fetch in time */
    uint32_t send_overruns;    /**< frames that found no place to wait */
    uint32_t flushed;          /**< frames thrown away by a bus-off */
    uint32_t bus_off_entries;  /**< times that the controller went off the bus */
    uint32_t bus_errors;       /**< polls that found a new error */
    uint8_t last_error;        /**< LEC: 1 stuff, 2 form, 3 acknowledge, 4, 5 bit, 6 CRC; 0 none */
    uint8_t transmit_errors;   /**< TEC, 0..255 */
    uint8_t receive_errors;    /**< REC, 0..255 */
} bxcan_counters_t;

typedef struct {
    can_frame_t ring[BXCAN_RING_SIZE];
    volatile uint32_t ring_head; /**< frames put in so far; written by the interrupts alone */
    volatile uint32_t ring_tail; /**< frames taken so far; written by the tick alone */
    can_frame_t waiting[BXCAN_WAITING_MAX]; /**< most urgent first */
    size_t waiting_count;
    can_frame_t in_mailbox[BXCAN_MAILBOXES];
    bool taken[BXCAN_MAILBOXES];
    bool bus_off;
    uint32_t losses_taken; /**< frames that bxcan_take_losses() has told */
    bxcan_counters_t counters;
} bxcan_t;

/** Resets the controller, sets bit rate and filters, joins the bus. Waits are bounded: 20,000 reads
 * each, about 5 ms. node_id: 1..127, or 255 for LSS alone. */
bxcan_start_t bxcan_start(uint8_t node_id, bxcan_t *can);

/** Sets the filters anew, after the node-id has changed; what arrives meanwhile is lost. */
void bxcan_filter(uint8_t node_id);

/** Empties a fifo (0 or 1) into the ring; true when SYNC was among the frames. */
bool bxcan_receive_interrupt(uint32_t fifo, bxcan_t *can);

/** Takes frames out of the ring, in order of arrival; returns how many, 0..size. */
size_t bxcan_receive(bxcan_t *can, can_frame_t *frames, size_t size);

/** Hands over frames; false when some found no place. */
bool bxcan_send(const can_frame_t *frames, size_t count, bxcan_t *can);

/** Refills the mailboxes. They hold three frames, 0.14 to 0.41 ms on the wire: once a joint tick is
 * often enough, and no transmit interrupt is used. */
void bxcan_transmit(bxcan_t *can);

/** Frames that were lost on their way in since the last call, a FIFO's overrun taken as one. */
uint32_t bxcan_take_losses(bxcan_t *can);

/** Reads the error state, once a tick; true while the controller is off the bus. */
bool bxcan_poll(bxcan_t *can);

#endif
