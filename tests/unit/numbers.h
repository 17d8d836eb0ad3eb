/** Torques and angles of either build, written and read in tests as float, or as double where every
 * bit counts. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include "control/number.h"

#ifdef CONTROL_FIXED_POINT
#define TORQUE_UNITS_PER_Nm 65536.0
#define ANGLE_UNITS_PER_rad 536870912.0
#define NUMBER_HALF 0.5
#else
#define TORQUE_UNITS_PER_Nm 1.0
#define ANGLE_UNITS_PER_rad 1.0
#define NUMBER_HALF 0.0
#endif

static inline torque_t torque_nearest(double torque_Nm) {
    return (torque_t)(torque_Nm * TORQUE_UNITS_PER_Nm +
                      (torque_Nm < 0.0 ? -NUMBER_HALF : NUMBER_HALF));
}

static inline angle_t angle_nearest(double angle_rad) {
    return (angle_t)(angle_rad * ANGLE_UNITS_PER_rad +
                     (angle_rad < 0.0 ? -NUMBER_HALF : NUMBER_HALF));
}

static inline double exactly_Nm(torque_t torque) {
    return (double)torque / TORQUE_UNITS_PER_Nm;
}

static inline double exactly_rad(angle_t angle) {
    return (double)angle / ANGLE_UNITS_PER_rad;
}

/** As the guard tells it to the bus. */
static inline int16_t in_mNm(torque_t torque) {
    const int16_t size_mNm = torque_size_to_mNm(torque_abs(torque));
    return (int16_t)(torque < 0 ? -size_mNm : size_mNm);
}

static inline torque_t torque_of(float torque_Nm) {
    return torque_nearest((double)torque_Nm);
}

static inline angle_t angle_of(float angle_rad) {
    return angle_nearest((double)angle_rad);
}

static inline float in_Nm(torque_t torque) {
    return (float)exactly_Nm(torque);
}

static inline float in_rad(angle_t angle) {
    return (float)exactly_rad(angle);
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
