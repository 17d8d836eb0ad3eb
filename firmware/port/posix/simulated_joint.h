/**
 * The joint of a motor node that runs alone: one inertia with viscous and Coulomb friction, driven
 * by the node's torque, an incremental encoder with an index pulse once per revolution, and the
 * motor's current.
 *
 * inertia x acceleration = torque - viscous x speed - Coulomb friction against the motion. At rest
 * the friction takes up any torque below it. Semi-implicit Euler in steps of 100 us at most.
 */
#ifndef SIMULATED_JOINT_H
#define SIMULATED_JOINT_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    double inertia_kg_m2;        /**< > 0 */
    double viscous_Nm_s;         /**< N m per rad/s, >= 0 */
    double coulomb_Nm;           /**< >= 0 */
    double torque_constant_Nm_A; /**< > 0 */
    double index_rad;            /**< of the index pulse, and one each revolution from there */
    uint32_t increments_per_revolution; /**< of the encoder, 256..2^24 */
    double angle_rad;                   /**< what the encoder shows at power-on */
    int8_t encoder_sign;                /**< < 0: the encoder is mounted the wrong way round */
} simulated_joint_config_t;

typedef struct {
    double angle_rad; /**< since power-on, as an incremental encoder counts */
    double speed_rad_s;
    bool index_seen;            /**< the index pulse passed in the last advance */
    int32_t index_position_inc; /**< where, as the timer's capture would hold it */
} simulated_joint_t;

/** Lets elapsed_us pass under a constant torque. */
void simulated_joint_advance(const simulated_joint_config_t *config, double torque_Nm,
                             uint32_t elapsed_us, simulated_joint_t *joint);

/** What the encoder shows: the nearest increment, saturated. */
int32_t simulated_joint_position_inc(const simulated_joint_config_t *config,
                                     const simulated_joint_t *joint);

/** Size of the current that makes this torque, saturated to the range of the type. */
uint32_t simulated_joint_current_mA(const simulated_joint_config_t *config, double torque_Nm);

#endif
