/**
 * The motor node served over a serial line as SLCAN: received bytes in, frames collected for
 * motor_node_step, text to send out. For a board without a transceiver and for the emulated one;
 * docs/emulated.md describes the line. No I/O: the port moves the bytes.
 *
 * Per received byte:
 *
 *     if (slcan_node_receive(&node, byte, &slcan, &text)) {  // a step is due
 *         slcan_node_input(&slcan, &input);
 *         motor_node_step(&config, &node, &input, &output);
 *         send(&text);
 *         slcan_node_output(&output, &slcan, &text);
 *     }
 *     send(&text);
 *
 * Stepped time base (2F01h = 1): the node's own RPDO4 closes the tick (node/tick_closing.h); a tick
 * number again is refused.
 * Free-running time base: the port's timer makes the same three calls with its own elapsed time.
 *
 * Commands: S0..S8 and O while closed, C while open, V, N, F, and t while open; what else comes is
 * refused with BEL, also frames with 29-bit identifiers (T, R) and remote frames (r), which no
 * object of the node uses. A CR alone is not answered. A t line is answered with CR after the step
 * that took it in and after the frames that this step sends: whoever has as many answers as it sent
 * lines knows that the node is through.
 */
#ifndef SLCAN_NODE_H
#define SLCAN_NODE_H

#include "node/tick_closing.h"
#include "port/slcan/slcan.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Flags of F, cleared by reading them. Each is also a frame counted in 2201h:08. */
#define SLCAN_NODE_BUFFER_FULL 0x01U   /**< a frame beyond MOTOR_NODE_RX_MAX in a step */
#define SLCAN_NODE_TICK_REPEATED 0x08U /**< RPDO4 with the tick number of the last closing */
#define SLCAN_NODE_GARBLED 0x80U       /**< a line that was none, or lost bytes */

/** Most that one call writes: MOTOR_NODE_TX_MAX lines and an answer to each frame taken in. */
#define SLCAN_NODE_TEXT_MAX (MOTOR_NODE_TX_MAX * SLCAN_TEXT_MAX + MOTOR_NODE_RX_MAX + 1U)

/** To be sent. */
typedef struct {
    size_t length;
    char text[SLCAN_NODE_TEXT_MAX];
} slcan_node_text_t;

/** All zero at power-on; outlives an NMT reset of the node, as an adapter would. */
typedef struct {
    slcan_line_t line;
    bool open;            /**< the channel: between O and C */
    uint8_t flags;        /**< bits, see above; 0..255 */
    uint32_t frames_lost; /**< since the last step */
    bool step_due;
    tick_closing_t closing;
    uint32_t elapsed_us; /**< of the step that is due */
    can_frame_t frames[MOTOR_NODE_RX_MAX];
    size_t frame_count; /**< waiting for the step */
    size_t answers_due; /**< for the frames that the step under way takes in */
} slcan_node_t;

/** One received byte; text: what to send at once, length 0..MOTOR_NODE_RX_MAX + 1. True: a step is
 * due before the next byte is taken in. */
bool slcan_node_receive(const motor_node_t *node, uint8_t byte, slcan_node_t *slcan,
                        slcan_node_text_t *text);

/** A frame of a bus in place of a line, for a port that has one: the same queue, the same rule of
 * the stepped time base. text: for the answer to a line, not to be sent. True: a step is due before
 * the next frame is taken in. */
bool slcan_node_take(const motor_node_t *node, const can_frame_t *frame, slcan_node_t *slcan,
                     slcan_node_text_t *text);

/** The receiver has lost bytes: the line under way will be refused. */
void slcan_node_lose(slcan_node_t *slcan);

/** Puts the frames into the input of a step, and its elapsed time when it is due by RPDO4. The
 * frames stay valid until slcan_node_output. */
void slcan_node_input(slcan_node_t *slcan, motor_node_input_t *input);

/** After the step: its frames, then the answers to those that it took in. While the channel is
 * closed frames are not sent. */
void slcan_node_output(const motor_node_output_t *output, slcan_node_t *slcan,
                       slcan_node_text_t *text);

#ifdef __cplusplus
}
#endif

#endif
