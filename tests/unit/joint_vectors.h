/** The shared vectors as records of a file, and a joint controller that follows them: the layout
 * that tests/vectors/joint_vectors.py writes, little-endian, after two 32-bit numbers: lanes, and
 * steps of each. */
#ifndef JOINT_VECTORS_H
#define JOINT_VECTORS_H

#include "control/joint_controller.h"

#define EVENT_COMMAND 1U
#define EVENT_RESET 2U
#define EVENT_HOLD 4U

typedef struct {
    uint32_t increments_per_revolution;
    uint32_t ticks_per_sync;
    uint32_t error_growth;
    uint32_t q_a_urad;
    uint32_t q_p_urad;
    uint32_t q_b_urad;
    uint32_t torque_limit_mNm;
    uint32_t delta_inc256;
    uint32_t stall_time_us;
    uint32_t steep;
    int32_t position_min_inc;
    int32_t position_max_inc;
    double tolerance_Nm;
} lane_t;

typedef struct {
    uint32_t events;
    uint32_t elapsed_us;
    int32_t position_inc;
    uint32_t ramp_ppm;
    int32_t target_inc;
    int32_t torque_mNm;
    int32_t torque_max_mNm;
    /* what the reference says, after the step */
    int32_t converging;
    int32_t direction;
    int32_t sign;
    int32_t extreme_inc;
    uint32_t age_us;
    int32_t guarded_mNm;
    int32_t unused;
    double error_rad;
    double torque_Nm;
    double f_max_Nm;
    double a_max_rad;
    double extreme_rad;
    double margin_rad;
} step_t;

static inline joint_controller_config_t config_of(const lane_t *lane) {
    const joint_controller_config_t config = {
        .fic =
            {
                .phase_rule = lane->error_growth != 0U ? FIC_ERROR_GROWTH : FIC_BODY_MOTION,
                .delta_inc256 = (uint16_t)lane->delta_inc256,
                .delta_rad = angle_part(angle_scale(lane->increments_per_revolution, 1).step_rad,
                                        (uint16_t)lane->delta_inc256, 256),
                .stall_time_us = lane->stall_time_us,
            },
        .q_a_rad = angle_from_urad(lane->q_a_urad),
        .q_p_rad = angle_from_urad(lane->q_p_urad),
        .q_b_rad = angle_from_urad(lane->q_b_urad),
        .torque_limit_Nm = torque_from_mNm((int32_t)lane->torque_limit_mNm, 1),
        .scale = angle_scale(lane->increments_per_revolution, lane->ticks_per_sync),
        .ticks_per_sync = (uint8_t)lane->ticks_per_sync,
    };
    return config;
}

static inline joint_command_t command_of(const step_t *step) {
    const joint_command_t command = {.position_inc = step->target_inc,
                                     .torque_mNm = (int16_t)step->torque_mNm,
                                     .torque_max_mNm = (uint16_t)step->torque_max_mNm};
    return command;
}

static inline void apply_events(const step_t *step, const joint_command_t *command,
                                joint_controller_t *controller) {
    if ((step->events & EVENT_COMMAND) != 0U) {
        joint_controller_command(command, controller);
    }
    if ((step->events & EVENT_RESET) != 0U) {
        joint_controller_reset(step->position_inc, command, controller);
    }
    if ((step->events & EVENT_HOLD) != 0U) {
        joint_controller_hold(step->position_inc, controller);
    }
}

#endif
