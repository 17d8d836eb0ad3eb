#include "control/torque_profile.h"

torque_t torque_profile(const torque_profile_t *profile, angle_t a_rad) {
    if (a_rad < profile->q_a_rad) {
        return torque_fraction(profile->t1_Nm, a_rad, profile->q_a_rad);
    }
    if (a_rad <= profile->q_p_rad) {
        return profile->t1_Nm;
    }
    if (a_rad < profile->q_b_rad) {
        return torque_between(profile->t1_Nm, profile->t2_Nm,
                              angle_distance(a_rad, profile->q_p_rad),
                              angle_distance(profile->q_b_rad, profile->q_p_rad));
    }
    return profile->t2_Nm;
}
