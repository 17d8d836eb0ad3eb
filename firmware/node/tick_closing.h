/**
 * When a node in the stepped time base (2F01h = 1) takes its joint tick, and how much node time
 * that is: one rule for every port, whatever carries the frames.
 *
 * The node's own RPDO4 closes the tick, whatever the NMT state. All frames since the last closing,
 * RPDO4 included, go into the step. The elapsed time is the difference of RPDO4's tick numbers
 * (8 bits) times 1006h, or times 1 ms where 1006h is 0. The first RPDO4 after 2F01h was set counts
 * as one tick. A tick number again closes nothing: the port counts the frame as lost.
 */
#ifndef TICK_CLOSING_H
#define TICK_CLOSING_H

#include "node/motor_node.h"

#ifdef __cplusplus
extern "C" {
#endif

/** All zero at power-on; outlives an NMT reset of the node. */
typedef struct {
    bool known;   /**< tick is of a closing since 2F01h was set */
    uint8_t tick; /**< of the last closing */
} tick_closing_t;

typedef enum {
    TICK_GOES_ON,  /**< the frame waits for the step */
    TICK_CLOSED,   /**< a step is due, this frame included */
    TICK_REPEATED, /**< the tick number of the last closing: the frame is lost */
} tick_closing_event_t;

/** One received frame; elapsed_us (0..1000000) is set where it closes the tick. */
tick_closing_event_t tick_closing_receive(const motor_node_t *node, const can_frame_t *frame,
                                          tick_closing_t *closing, uint32_t *elapsed_us);

#ifdef __cplusplus
}
#endif

#endif
