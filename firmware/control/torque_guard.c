#include "control/torque_guard.h"

static torque_t cut(torque_t torque, torque_t bound, uint16_t reason, uint16_t *reasons) {
    const torque_t result = torque_clamp(torque, bound);
    if (result != torque) {
        *reasons |= reason;
    }
    return result;
}

torque_guard_output_t torque_guard(const torque_guard_input_t *input) {
    torque_guard_output_t output = {0};
    const torque_t ramp_bound =
        torque_part(input->torque_limit_Nm, input->ramp_ppm, TORQUE_GUARD_RAMP_FULL);
    const torque_t shape_bound = torque_max(input->torque_max_Nm, input->f_max_Nm);
    if (!torque_is_number(input->torque_Nm) || !torque_is_number(input->torque_limit_Nm) ||
        !torque_is_number(input->torque_max_Nm) || !torque_is_number(input->f_max_Nm)) {
        output.reasons = LIMIT_REASON_NOT_A_NUMBER;
        return output;
    }
    torque_t torque = input->torque_Nm;
    torque = cut(torque, shape_bound, LIMIT_REASON_TORQUE_MAX, &output.reasons);
    torque = cut(torque, input->torque_limit_Nm, LIMIT_REASON_TORQUE_LIMIT, &output.reasons);
    torque = cut(torque, ramp_bound, LIMIT_REASON_BOUND_RAMP, &output.reasons);
    const bool outward = (torque > 0 && input->position_inc >= input->position_max_inc) ||
                         (torque < 0 && input->position_inc <= input->position_min_inc);
    if (outward) {
        torque = 0;
        output.reasons |= LIMIT_REASON_POSITION_LIMIT;
    }
    output.torque_mNm = torque_to_mNm(torque);
    return output;
}
