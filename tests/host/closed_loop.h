/**
 * The whole chain in one small loop without a bus: host layers, three joint controllers
 * (two-plateau FIC) in double precision, the arm in ODE. Encoder, commands and torque are quantised
 * as on the bus, and command k comes from measurement k-1. It shows that the layers together move
 * as control.md says, and records torques for the tests of the plant.
 */
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hpmc/fic.h"

namespace test {

struct ReachFigures {
    double planned_r;
    double executed_r;
    double position_rmse_m;
    double velocity_rmse_m_s;
};

struct ClosedLoopRun {
    std::vector<ReachFigures> reaches;       ///< 16: eight targets, there and back
    Eigen::Vector3d q_start_rad;             ///< at the first recorded torque
    std::vector<Eigen::Vector3d> torques_Nm; ///< one a millisecond, from rest at home
};

/// The clock experiment once; offset_inc: start offset of the joints in encoder increments.
ClosedLoopRun run_clock(hpmc::PhaseRule phase_rule, const Eigen::Vector3d &offset_inc);

} // namespace test
