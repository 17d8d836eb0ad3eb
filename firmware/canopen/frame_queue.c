#include "canopen/frame_queue.h"

bool frame_queue_push(const can_frame_t *frame, frame_queue_t *queue) {
    if (queue->count == FRAME_QUEUE_SIZE) {
        return false;
    }
    queue->frames[(queue->first + queue->count) % FRAME_QUEUE_SIZE] = *frame;
    queue->count++;
    return true;
}

bool frame_queue_pop(frame_queue_t *queue, can_frame_t *frame) {
    if (queue->count == 0U) {
        return false;
    }
    *frame = queue->frames[queue->first];
    queue->first = (queue->first + 1U) % FRAME_QUEUE_SIZE;
    queue->count--;
    return true;
}
