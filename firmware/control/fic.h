/**
 * Fractal impedance controller of one axis: follows the force profile while the error diverges, and
 * a spring about the middle of the latched excursion while it converges.
 *
 * e = desired - actual, a = |e|. At the turning point a_max and f_max = F(a_max) are latched; in
 * convergence the torque is min(2 f_max / a_max (a - a_max / 2), F(a)) toward the desired point.
 * f_max stays latched although the profile may change, and the min() keeps a two-plateau profile
 * passive: with a fixed desired point no closed cycle of the position gains energy.
 *
 * Needs no velocity: the direction of motion comes from the reversal of the position by more than
 * delta, and is forgotten after stall_time without motion.
 *
 * Source: Tiseo, Charitos, Mistry 2021, and the fractal impedance papers cited there.
 */
#ifndef FIC_H
#define FIC_H

#include <stdbool.h>
#include <stdint.h>

#include "control/number.h"
#include "control/torque_profile.h"

typedef enum {
    FIC_BODY_MOTION = 0, /**< divergence while the body does not move toward the desired point */
    FIC_ERROR_GROWTH = 1 /**< divergence while |e| grows */
} fic_phase_rule_t;

typedef struct {
    fic_phase_rule_t phase_rule;
    uint16_t delta_inc256; /**< motion that counts as a reversal, in 1/256 increment */
    angle_t delta_rad;     /**< the same, for FIC_ERROR_GROWTH */
    uint32_t stall_time_us;
} fic_config_t;

typedef struct {
    int32_t position_inc;
    angle_t error_rad;
    uint32_t elapsed_us; /**< since the step before */
} fic_input_t;

typedef struct {
    int32_t extreme_inc; /**< farthest position in the present direction (qx) */
    uint32_t age_us;     /**< time since the position last moved on */
    angle_t a_max_rad;
    angle_t extreme_rad; /**< extreme of a within the phase (ext, FIC_ERROR_GROWTH) */
    torque_t f_max_Nm;
    int8_t direction; /**< of the body's motion: -1, 0 unknown, +1 */
    int8_t sign;      /**< of the error: -1, 0 before the first step, +1 */
    bool converging;
} fic_t;

/** To be called at enabling, change of mode and fault reset. */
void fic_reset(int32_t position_inc, fic_t *fic);

/** Torque toward the desired point, N m. Call once per joint tick. */
torque_t fic_step(const fic_config_t *config, const torque_profile_t *profile,
                  const fic_input_t *input, fic_t *fic);

#endif
