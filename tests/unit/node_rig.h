/*
 * One motor node (id 2) on a bench of frames: collects what is to be received in the next step,
 * steps one SYNC period of 1 ms, and keeps what was sent.
 */
#ifndef NODE_RIG_H
#define NODE_RIG_H

#include <string.h>

#include "node/motor_node.h"

#define NODE_ID 2U

typedef struct {
    motor_node_config_t config;
    motor_node_t node;
    motor_node_input_t input;
    motor_node_output_t output;
    can_frame_t frames[64];
    uint8_t sync_counter; /* 0: SYNC without counter */
    int32_t desired_inc;
} node_rig_t;

static node_rig_t rig;

static inline void rig_init(void) {
    memset(&rig, 0, sizeof rig);
    rig.config.node_id = NODE_ID;
    rig.config.serial_number = 0x12345678;
    rig.config.referenced = true;
    rig.input.elapsed_us = 1000;
    rig.input.position_inc = 5000;
    rig.input.temperature_dC = 251;
    rig.input.frames = rig.frames;
    rig.desired_inc = 5000;
    motor_node_init(&rig.config, &rig.node);
}

static inline void rig_send(uint16_t id, uint8_t len, const uint8_t *data) {
    can_frame_t *frame = &rig.frames[rig.input.frame_count++];
    memset(frame, 0, sizeof *frame);
    frame->id = id;
    frame->len = len;
    if (len != 0U) {
        memcpy(frame->data, data, len);
    }
}

static inline void rig_nmt(uint8_t command) {
    const uint8_t data[2] = {command, NODE_ID};
    rig_send(0x000, 2, data);
}

static inline void rig_sync(void) {
    if (rig.sync_counter == 0U) {
        rig_send(0x080, 0, NULL);
    } else {
        rig_send(0x080, 1, &rig.sync_counter);
        rig.sync_counter = (uint8_t)(rig.sync_counter % 240U + 1U);
    }
}

static inline void rig_command(int32_t position_inc, int16_t torque_mNm, uint16_t torque_max_mNm) {
    const uint32_t q = (uint32_t)position_inc;
    const uint16_t t = (uint16_t)torque_mNm;
    const uint8_t data[8] = {
        (uint8_t)q, (uint8_t)(q >> 8), (uint8_t)(q >> 16),      (uint8_t)(q >> 24),
        (uint8_t)t, (uint8_t)(t >> 8), (uint8_t)torque_max_mNm, (uint8_t)(torque_max_mNm >> 8)};
    rig_send(0x200 + NODE_ID, 8, data);
}

static inline void rig_control(uint16_t controlword, int8_t mode) {
    const uint8_t data[3] = {(uint8_t)controlword, (uint8_t)(controlword >> 8), (uint8_t)mode};
    rig_send(0x300 + NODE_ID, 3, data);
}

static inline void rig_inject(int32_t position_inc, uint8_t tick, uint8_t flags) {
    const uint32_t q = (uint32_t)position_inc;
    const uint8_t data[8] = {
        (uint8_t)q, (uint8_t)(q >> 8), (uint8_t)(q >> 16), (uint8_t)(q >> 24), tick, flags, 0x2C,
        0x01};
    rig_send(0x500 + NODE_ID, 8, data);
}

static inline void rig_write(uint16_t index, uint8_t subindex, uint8_t size, uint32_t value) {
    const uint8_t data[8] = {(uint8_t)(0x23U | (4U - size) << 2),
                             (uint8_t)index,
                             (uint8_t)(index >> 8),
                             subindex,
                             (uint8_t)value,
                             (uint8_t)(value >> 8),
                             (uint8_t)(value >> 16),
                             (uint8_t)(value >> 24)};
    rig_send(0x600 + NODE_ID, 8, data);
}

static inline void rig_read(uint16_t index, uint8_t subindex) {
    const uint8_t data[8] = {0x40, (uint8_t)index, (uint8_t)(index >> 8), subindex, 0, 0, 0, 0};
    rig_send(0x600 + NODE_ID, 8, data);
}

/* One step with the frames collected so far. */
static inline void rig_step(void) {
    motor_node_step(&rig.config, &rig.node, &rig.input, &rig.output);
    rig.input.frame_count = 0;
}

/* One regular SYNC period: command, SYNC, step. */
static inline void rig_cycle(void) {
    rig_command(rig.desired_inc, 3000, 4000);
    rig_sync();
    rig_step();
}

static inline void rig_cycles(int count) {
    for (int i = 0; i < count; i++) {
        rig_cycle();
    }
}

/* Frame with this identifier among those just sent; NULL when there is none. */
static inline const can_frame_t *rig_sent(uint16_t id) {
    for (size_t i = 0; i < rig.output.frame_count; i++) {
        if (rig.output.frames[i].id == id) {
            return &rig.output.frames[i];
        }
    }
    return NULL;
}

static inline uint32_t rig_u32(const uint8_t *data) {
    return (uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 |
           (uint32_t)data[3] << 24;
}

/* Abort code of the SDO response just sent; 0 when it is no abort, 1 when there is no response. */
static inline uint32_t rig_abort(void) {
    const can_frame_t *response = rig_sent(0x580 + NODE_ID);
    if (response == NULL) {
        return 1;
    }
    return response->data[0] == 0x80U ? rig_u32(&response->data[4]) : 0U;
}

/* Code of the emergency just sent; 0 = none. */
static inline uint16_t rig_emergency(void) {
    const can_frame_t *frame = rig_sent(0x080 + NODE_ID);
    return frame == NULL ? 0U : (uint16_t)(frame->data[0] | frame->data[1] << 8);
}

/* Operational, with SYNCs and commands running. */
static inline void rig_start(void) {
    rig_step();
    rig_nmt(1);
    rig_step();
    rig_cycles(3);
}

/* Operation enabled in mode -1, the bound still near zero. */
static inline void rig_enable(void) {
    rig_control(0x06, -1);
    rig_cycle();
    rig_control(0x07, 0);
    rig_cycle();
    rig_control(0x0F, 0);
    rig_cycle();
}

/* Operation enabled with the bound at TA. */
static inline void rig_run(void) {
    rig_start();
    rig_enable();
    rig_cycles(101);
}

#endif
