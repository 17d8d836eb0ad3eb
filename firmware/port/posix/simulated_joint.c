#include "port/posix/simulated_joint.h"

#include <math.h>

#include "port/posix/encoder_model.h"

static const double TWO_PI = 6.283185307179586;
#define STEP_us 100U

static void step(const simulated_joint_config_t *config, double torque_Nm, double step_s,
                 simulated_joint_t *joint) {
    const double free_Nm = torque_Nm - config->viscous_Nm_s * joint->speed_rad_s;
    const double speed_rad_s = joint->speed_rad_s + free_Nm * step_s / config->inertia_kg_m2;
    const double friction_rad_s = config->coulomb_Nm * step_s / config->inertia_kg_m2;
    joint->speed_rad_s = fabs(speed_rad_s) <= friction_rad_s
                             ? 0.0
                             : speed_rad_s - copysign(friction_rad_s, speed_rad_s);
    joint->angle_rad += joint->speed_rad_s * step_s;
}

static int32_t encoder_inc(const simulated_joint_config_t *config, double since_start_rad) {
    const double counted_rad = config->encoder_sign < 0 ? -since_start_rad : since_start_rad;
    return encoder_model_increments(config->angle_rad + counted_rad,
                                    config->increments_per_revolution);
}

/** Number of the index pulse at or below an angle. */
static double index_below(const simulated_joint_config_t *config, double angle_rad) {
    return floor((angle_rad - config->index_rad) / TWO_PI);
}

void simulated_joint_advance(const simulated_joint_config_t *config, double torque_Nm,
                             uint32_t elapsed_us, simulated_joint_t *joint) {
    const double before_rad = joint->angle_rad;
    const uint32_t steps = elapsed_us / STEP_us + (elapsed_us % STEP_us != 0U ? 1U : 0U);
    for (uint32_t i = 0; i < steps; i++) {
        step(config, torque_Nm, (double)elapsed_us * 1e-6 / (double)steps, joint);
    }
    const double below = index_below(config, before_rad);
    const double now = index_below(config, joint->angle_rad);
    joint->index_seen = now != below;
    if (joint->index_seen) {
        const double at_rad = config->index_rad + TWO_PI * fmax(below, now);
        joint->index_position_inc = encoder_inc(config, at_rad);
    }
}

int32_t simulated_joint_position_inc(const simulated_joint_config_t *config,
                                     const simulated_joint_t *joint) {
    return encoder_inc(config, joint->angle_rad);
}

uint32_t simulated_joint_current_mA(const simulated_joint_config_t *config, double torque_Nm) {
    const double current_mA = fabs(torque_Nm) * 1000.0 / config->torque_constant_Nm_A;
    return current_mA < (double)UINT32_MAX ? (uint32_t)current_mA : UINT32_MAX;
}
