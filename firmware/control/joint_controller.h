/**
 * Joint torque controller of one motor: interpolates the commands of the joint coordination between
 * SYNCs and turns them, with the fractal impedance controller, into a torque within +-TA.
 *
 * The joint loop runs J = ticks_per_sync times per SYNC. J = 1: the command of SYNC k acts at SYNC
 * k. J > 1: from SYNC k to k + 1 the command goes linearly from command k - 1 to command k, the
 * first tick at command k - 1; a late SYNC finds the end point held. The error Q_d - q is exact: it
 * is formed in 1/J increment.
 *
 * |torque| may exceed T_max while braking in convergence, up to the latched f_max: T_max is a
 * shape, TA is the limit. Source: Tiseo et al. 2021, joint torque controllers.
 */
#ifndef JOINT_CONTROLLER_H
#define JOINT_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#include "control/fic.h"
#include "control/number.h"

/** Output of the joint coordination for this joint. */
typedef struct {
    int32_t position_inc;    /**< Q_d */
    int16_t torque_mNm;      /**< T_d, -32767..32767; its size shapes the profile */
    uint16_t torque_max_mNm; /**< T_max, 0..32767 */
} joint_command_t;

typedef struct {
    fic_config_t fic;
    angle_t q_a_rad; /**< profile, see torque_profile.h */
    angle_t q_p_rad;
    angle_t q_b_rad;
    torque_t torque_limit_Nm; /**< TA */
    angle_scale_t scale;      /**< of 1/J increment */
    uint8_t ticks_per_sync;   /**< J, 1..10 */
} joint_controller_config_t;

typedef struct {
    joint_command_t before;
    joint_command_t now;
    uint8_t tick; /**< since SYNC, 0..J */
    fic_t fic;
} joint_controller_t;

typedef struct {
    torque_t torque_Nm;     /**< within +-TA */
    torque_t torque_max_Nm; /**< T_max of this tick */
    torque_t f_max_Nm;      /**< latched by the FIC */
    angle_t error_rad;
    bool limited; /**< TA cut the torque */
} joint_controller_output_t;

/** Starts the FIC afresh at this position; this command acts at once. */
void joint_controller_reset(int32_t position_inc, const joint_command_t *command,
                            joint_controller_t *controller);

/** The command that begins to act at this SYNC. */
void joint_controller_command(const joint_command_t *command, joint_controller_t *controller);

/** From now on Q_d is this position, and the FIC starts afresh at it; T_d and T_max stay. */
void joint_controller_hold(int32_t position_inc, joint_controller_t *controller);

/** One joint tick. */
void joint_controller_step(const joint_controller_config_t *config, int32_t position_inc,
                           uint32_t elapsed_us, joint_controller_t *controller,
                           joint_controller_output_t *output);

#endif
