#include "control/torque_guard.h"

/** Cuts the size of a torque. */
static torque_t cut(torque_t size, torque_t bound, uint16_t reason, uint16_t *reasons) {
    if (size <= bound) {
        return size;
    }
    *reasons |= reason;
    return bound;
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
    if (!torques_are_numbers(input->torque_Nm, input->torque_limit_Nm) ||
        !torques_are_numbers(input->torque_max_Nm, input->f_max_Nm) ||
        !torque_is_number(input->torque_before_Nm)) {
        output.reasons = LIMIT_REASON_NOT_A_NUMBER;
        return output;
    }
    torque_t torque = input->torque_Nm;
    if (input->slope_mNm_s != TORQUE_GUARD_SLOPE_OFF) {
        torque = slow(input, &output.reasons);
    }
    const bool negative = torque < 0;
    bool accelerates = torque > 0 && input->moving > 0;
    bool beyond = input->position_inc >= input->position_max_inc;
    if (negative) {
        accelerates = input->moving < 0;
        beyond = input->position_inc <= input->position_min_inc;
    }
    torque_t limit = input->torque_limit_Nm;
    if (derating_applies(&input->motor, accelerates)) {
        const derating_output_t derated = derating(&input->motor, accelerates);
        output.reasons |= derated.reasons;
        limit = torque_part(limit, (uint32_t)derated.share, DERATING_FULL);
    }
    torque_t size = torque_abs(torque); /* the bounds are symmetric */
    size = cut(size, torque_max(input->torque_max_Nm, input->f_max_Nm), LIMIT_REASON_TORQUE_MAX,
               &output.reasons);
    size = cut(size, limit, LIMIT_REASON_TORQUE_LIMIT, &output.reasons);
    if (input->ramp_ppm < TORQUE_GUARD_RAMP_FULL) {
        size = cut(size, torque_part(limit, input->ramp_ppm, TORQUE_GUARD_RAMP_FULL),
                   LIMIT_REASON_BOUND_RAMP, &output.reasons);
    }
    if (beyond && size > 0) {
        size = 0;
        output.reasons |= LIMIT_REASON_POSITION_LIMIT;
    }
    const int16_t size_mNm = torque_size_to_mNm(size);
    output.torque_Nm = negative ? torque_negated(size) : size;
    output.torque_mNm = (int16_t)(negative ? -size_mNm : size_mNm);
    return output;
}
