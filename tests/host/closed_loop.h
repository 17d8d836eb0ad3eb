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
#include "plant/arm_plant.h"

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

/// A hand held against a wall for 2 s; forces along the normal, into the wall.
struct Press {
    double peak_N;
    double rest_N;       ///< mean over the last 0.5 s
    double rest_depth_m; ///< of the hand in the surface, mean over the last 0.5 s
    int breaks;          ///< the hand left the surface
    int late_breaks;     ///< later than 0.3 s after it first touched
};

/// From rest at home to a target behind the wall. The host is given wrench_gain times the measured
/// wrench: 1 is the rig, 0 a rig without the sensor, -1 one with the sensor the wrong way round.
Press press_wall(const hpmc::WallConfig &wall, const Eigen::Vector2d &target_m, double wrench_gain);

} // namespace test
