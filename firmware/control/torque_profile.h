/**
 * The force profile F(a) of a joint: torque over the size of the position error, with two plateaus.
 *
 *        T2 |                 ______
 *           |                /
 *        T1 |      _________/
 *           |     /
 *         0 |____/________________ a
 *               q_a     q_p  q_b
 *
 * Angles in rad, 0 < q_a <= q_p <= q_b; torques in N m, 0 <= T1 <= T2. F is continuous (unless
 * q_p = q_b), never falls and is never negative. Source: Tiseo et al. 2021, joint torque
 * controllers.
 */
#ifndef TORQUE_PROFILE_H
#define TORQUE_PROFILE_H

#include "control/number.h"

typedef struct {
    angle_t q_a_rad;
    angle_t q_p_rad;
    angle_t q_b_rad;
    torque_t t1_Nm;
    torque_t t2_Nm;
} torque_profile_t;

/** F(a), for a >= 0. Here, since it is a part of every joint tick. */
static inline torque_t torque_profile(const torque_profile_t *profile, angle_t a_rad) {
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

#endif
