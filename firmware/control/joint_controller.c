#include "control/joint_controller.h"

void joint_controller_reset(int32_t position_inc, const joint_command_t *command,
                            joint_controller_t *controller) {
    controller->before = *command;
    controller->now = *command;
    controller->tick = 0;
    fic_reset(position_inc, &controller->fic);
}

void joint_controller_command(const joint_command_t *command, joint_controller_t *controller) {
    controller->before = controller->now;
    controller->now = *command;
    controller->tick = 0;
}

void joint_controller_hold(int32_t position_inc, joint_controller_t *controller) {
    controller->now.position_inc = position_inc;
    controller->before = controller->now;
    fic_reset(position_inc, &controller->fic); /* else its brake at zero error would jolt */
}

void joint_controller_step(const joint_controller_config_t *config, int32_t position_inc,
                           uint32_t elapsed_us, joint_controller_t *controller,
                           joint_controller_output_t *output) {
    const joint_command_t *before = &controller->before;
    const joint_command_t *now = &controller->now;
    const int32_t parts = config->ticks_per_sync;
    int32_t interpolates = 1; /* a factor: a condition would cost the products more */
    if (parts == 1) {
        interpolates = 0;
    }
    const int32_t left = (parts - (int32_t)controller->tick) * interpolates;
    const int32_t part = parts - left;
    if (controller->tick < config->ticks_per_sync) {
        controller->tick++;
    }

    /* parts times what lies between the two commands; the profile takes the lesser torque. */
    const int64_t error_steps = (int64_t)now->position_inc * part +
                                (int64_t)before->position_inc * left -
                                (int64_t)position_inc * parts;
    const int32_t t_d_mNm_parts = now->torque_mNm * part + before->torque_mNm * left;
    const int32_t t_max_mNm_parts =
        (int32_t)now->torque_max_mNm * part + (int32_t)before->torque_max_mNm * left;
    const int32_t t_d_size_mNm_parts = t_d_mNm_parts < 0 ? -t_d_mNm_parts : t_d_mNm_parts;
    const int32_t t1_mNm_parts =
        t_d_size_mNm_parts < t_max_mNm_parts ? t_d_size_mNm_parts : t_max_mNm_parts;
    const torque_t t_max = torque_from_mNm(t_max_mNm_parts, config->ticks_per_sync);

    const torque_profile_t profile = {
        .q_a_rad = config->q_a_rad,
        .q_p_rad = config->q_p_rad,
        .q_b_rad = config->q_b_rad,
        .t1_Nm = torque_from_mNm(t1_mNm_parts, config->ticks_per_sync),
        .t2_Nm = t_max,
    };
    const fic_input_t input = {
        .position_inc = position_inc,
        .error_rad = angle_from_steps(&config->scale, error_steps),
        .elapsed_us = elapsed_us,
    };
    const torque_t asked = fic_step(&config->fic, &profile, &input, &controller->fic);

    const torque_t limit = config->torque_limit_Nm;
    output->torque_Nm = asked;
    output->limited = true;
    if (asked > limit) {
        output->torque_Nm = limit;
    } else if (asked < torque_negated(limit)) {
        output->torque_Nm = torque_negated(limit);
    } else {
        output->limited = false;
    }
    output->torque_max_Nm = t_max;
    output->f_max_Nm = controller->fic.f_max_Nm;
    output->error_rad = input.error_rad;
}
