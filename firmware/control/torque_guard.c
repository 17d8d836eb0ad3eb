#include "control/torque_guard.h"

static torque_t cut(torque_t torque, torque_t bound, uint16_t reason, uint16_t *reasons) {
    const torque_t result = torque_clamp(torque, bound);
    if (result != torque) {
        *reasons |= reason;
    }
    return result;
}

static torque_t slow(const torque_guard_input_t *input, uint16_t *reasons) {
    const torque_t step = torque_from_slope(input->slope_mNm_s, input->elapsed_us);
    const torque_t low = torque_difference(input->torque_before_Nm, step);
    const torque_t high = torque_sum(input->torque_before_Nm, step);
    const torque_t result = torque_min(torque_max(input->torque_Nm, low), high);
    if (result != input->torque_Nm) {
        *reasons |= LIMIT_REASON_TORQUE_SLOPE;
    }
    return result;
}

torque_guard_output_t torque_guard(const torque_guard_input_t *input) {
    torque_guard_output_t output = {0};
    if (!torque_is_number(input->torque_Nm) || !torque_is_number(input->torque_limit_Nm) ||
        !torque_is_number(input->torque_max_Nm) || !torque_is_number(input->f_max_Nm) ||
        !torque_is_number(input->torque_before_Nm)) {
        output.reasons = LIMIT_REASON_NOT_A_NUMBER;
        return output;
    }
    torque_t torque = input->torque_Nm;
    if (input->slope_mNm_s != TORQUE_GUARD_SLOPE_OFF) {
        torque = slow(input, &output.reasons);
    }
    const bool accelerates = (torque > 0 && input->moving > 0) || (torque < 0 && input->moving < 0);
    const derating_output_t derated = derating(&input->motor, accelerates);
    output.reasons |= derated.reasons;
    torque_t limit = input->torque_limit_Nm;
    if (derated.share < DERATING_FULL) {
        limit = torque_part(limit, (uint32_t)derated.share, DERATING_FULL);
    }
    torque = cut(torque, torque_max(input->torque_max_Nm, input->f_max_Nm), LIMIT_REASON_TORQUE_MAX,
                 &output.reasons);
    torque = cut(torque, limit, LIMIT_REASON_TORQUE_LIMIT, &output.reasons);
    if (input->ramp_ppm < TORQUE_GUARD_RAMP_FULL) {
        torque = cut(torque, torque_part(limit, input->ramp_ppm, TORQUE_GUARD_RAMP_FULL),
                     LIMIT_REASON_BOUND_RAMP, &output.reasons);
    }
    const bool outward = (torque > 0 && input->position_inc >= input->position_max_inc) ||
                         (torque < 0 && input->position_inc <= input->position_min_inc);
    if (outward) {
        torque = 0;
        output.reasons |= LIMIT_REASON_POSITION_LIMIT;
    }
    output.torque_Nm = torque;
    output.torque_mNm = torque_to_mNm(torque);
    return output;
}
