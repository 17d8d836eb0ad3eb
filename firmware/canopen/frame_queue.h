/**
 * Frames that wait to be sent, in order.
 */
#ifndef FRAME_QUEUE_H
#define FRAME_QUEUE_H

#include <stdbool.h>
#include <stddef.h>

#include "canopen/can_frame.h"

#define FRAME_QUEUE_SIZE 40U

typedef struct {
    can_frame_t frames[FRAME_QUEUE_SIZE];
    size_t first;
    size_t count;
} frame_queue_t;

/** False, and the frame is lost, when the queue is full. */
bool frame_queue_push(const can_frame_t *frame, frame_queue_t *queue);

/** False when the queue is empty. */
bool frame_queue_pop(frame_queue_t *queue, can_frame_t *frame);

#endif
