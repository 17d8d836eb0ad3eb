#include "control/torque_profile.h"

torque_t torque_profile(const torque_profile_t *profile, angle_t a_rad) {
    if (a_rad < profile->q_a_rad) {
        return torque_scaled(profile->t1_Nm, a_rad, profile->q_a_rad);
    }
    if (a_rad <= profile->q_p_rad) {
        return profile->t1_Nm;
    }
    if (a_rad < profile->q_b_rad) {
        return torque_sum(profile->t1_Nm,
                          torque_scaled(torque_difference(profile->t2_Nm, profile->t1_Nm),
                                        angle_difference(a_rad, profile->q_p_rad),
                                        angle_difference(profile->q_b_rad, profile->q_p_rad)));
    }
    return profile->t2_Nm;
}
