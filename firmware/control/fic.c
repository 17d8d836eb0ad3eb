#include "control/fic.h"

void fic_reset(int32_t position_inc, fic_t *fic) {
    fic->extreme_inc = position_inc;
    fic->age_us = 0;
    fic->a_max_rad = 0;
    fic->extreme_rad = 0;
    fic->f_max_Nm = 0;
    fic->direction = 0;
    fic->sign = 0;
    fic->converging = false;
}

/** low_inc <= high_inc */
static bool moved_back(const fic_config_t *config, int32_t low_inc, int32_t high_inc) {
    const int64_t way_inc = (int64_t)high_inc - low_inc;
    return (uint32_t)way_inc >
           (uint32_t)config->delta_inc256 / 256U; /* both whole: so is 256 way > delta */
}

static int8_t direction_of_motion(const fic_config_t *config, const fic_input_t *input,
                                  fic_t *fic) {
    const int32_t q = input->position_inc;
    if (fic->direction >= 0) {
        if (q >= fic->extreme_inc) {
            if (q > fic->extreme_inc) {
                fic->age_us = 0;
            }
            fic->extreme_inc = q;
        } else if (moved_back(config, q, fic->extreme_inc)) {
            fic->direction = -1;
            fic->extreme_inc = q;
            fic->age_us = 0;
        }
    } else {
        if (q <= fic->extreme_inc) {
            if (q < fic->extreme_inc) {
                fic->age_us = 0;
            }
            fic->extreme_inc = q;
        } else if (moved_back(config, fic->extreme_inc, q)) {
            fic->direction = 1;
            fic->extreme_inc = q;
            fic->age_us = 0;
        }
    }
    if (fic->age_us <= config->stall_time_us) { /* stays a little beyond, never wraps */
        fic->age_us += input->elapsed_us;
    }
    if (fic->age_us > config->stall_time_us) {
        return 0;
    }
    return fic->direction;
}

static void latch(angle_t a, torque_t f, fic_t *fic) {
    fic->a_max_rad = a;
    fic->f_max_Nm = f;
}

static void phase_by_body_motion(const fic_config_t *config, const fic_input_t *input, angle_t a,
                                 torque_t f, bool crossed, fic_t *fic) {
    const int8_t direction = direction_of_motion(config, input, fic);
    fic->converging =
        (direction > 0 && input->error_rad > 0) || (direction < 0 && input->error_rad < 0);
    if (crossed || !fic->converging || a > fic->a_max_rad) {
        latch(a, f, fic);
    }
}

static void phase_by_error_growth(const fic_config_t *config, angle_t a, torque_t f, bool crossed,
                                  fic_t *fic) {
    if (crossed) {
        fic->converging = false;
        fic->extreme_rad = a;
        latch(a, f, fic);
    } else if (!fic->converging) {
        if (a >= fic->a_max_rad) {
            latch(a, f, fic);
        } else if (a < angle_difference(fic->a_max_rad, config->delta_rad)) {
            fic->converging = true;
            fic->extreme_rad = a;
        }
    } else if (a <= fic->extreme_rad) {
        fic->extreme_rad = a;
    } else if (a > angle_sum(fic->extreme_rad, config->delta_rad)) {
        fic->converging = false;
        latch(a, f, fic);
    }
}

torque_t fic_step(const fic_config_t *config, const torque_profile_t *profile,
                  const fic_input_t *input, fic_t *fic) {
    const int8_t sign = input->error_rad < 0 ? -1 : 1;
    const angle_t a = angle_abs(input->error_rad);
    const torque_t f = torque_profile(profile, a);
    const bool crossed = sign != fic->sign;
    fic->sign = sign;
    if (config->phase_rule == FIC_ERROR_GROWTH) {
        phase_by_error_growth(config, a, f, crossed, fic);
    } else {
        phase_by_body_motion(config, input, a, f, crossed, fic);
    }

    torque_t torque = f;
    if (fic->converging) {
        const torque_t spring =
            fic->a_max_rad > 0
                ? torque_fraction(fic->f_max_Nm, angle_past_half(a, fic->a_max_rad), fic->a_max_rad)
                : 0;
        torque = torque_min(spring, f);
    }
    return sign < 0 ? torque_negated(torque) : torque;
}
