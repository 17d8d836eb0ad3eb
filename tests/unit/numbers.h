/** Torques and angles of either build, written and read as float in tests. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include "control/number.h"

static inline torque_t torque_of(float torque_Nm) {
#ifdef CONTROL_FIXED_POINT
    return (torque_t)(torque_Nm * 65536.0f + (torque_Nm < 0.0f ? -0.5f : 0.5f));
#else
    return torque_Nm;
#endif
}

static inline angle_t angle_of(float angle_rad) {
#ifdef CONTROL_FIXED_POINT
    return (angle_t)(angle_rad * 536870912.0f + (angle_rad < 0.0f ? -0.5f : 0.5f));
#else
    return angle_rad;
#endif
}

static inline float in_Nm(torque_t torque) {
#ifdef CONTROL_FIXED_POINT
    return (float)torque / 65536.0f;
#else
    return torque;
#endif
}

static inline float in_rad(angle_t angle) {
#ifdef CONTROL_FIXED_POINT
    return (float)angle / 536870912.0f;
#else
    return angle;
#endif
}

/** Rounding of the build: what two ways to one result may differ by. */
#ifdef CONTROL_FIXED_POINT
#define TORQUE_STEP_Nm 1.6e-5f
#define ANGLE_STEP_rad 1.9e-9f
#else
#define TORQUE_STEP_Nm 1e-6f
#define ANGLE_STEP_rad 1e-9f
#endif

#endif
