/**
 * The simulated absolute encoder: joint angle to increments, used alike for direct and injected
 * sensors, so that both see the same quantisation.
 */
#ifndef ENCODER_MODEL_H
#define ENCODER_MODEL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Nearest increment of angle_rad, saturated to the 32-bit range (nothing wraps). NaN gives 0.
 * increments_per_revolution: 608Fh, 2^10..2^24. */
int32_t encoder_model_increments(double angle_rad, uint32_t increments_per_revolution);

#ifdef __cplusplus
}
#endif

#endif
