#include "hpmc/joint_coordination.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hpmc {

JointCoordination::JointCoordination(const JointCoordinationConfig &config)
    : config_(config),
      filter_gain_(1.0 - std::exp(-2.0 * M_PI * config.wrench_cutoff_Hz * config.period_s)) {
    if (!config.torque_limit_Nm.allFinite() || !(config.torque_limit_Nm.minCoeff() > 0.0)) {
        throw std::invalid_argument("joint_coordination.torque_limit_Nm: must be above 0");
    }
    if (!(config.wrench_cutoff_Hz >= 20.0 && config.wrench_cutoff_Hz <= 200.0)) {
        throw std::invalid_argument("joint_coordination.wrench_cutoff_Hz: must be in 20..200");
    }
    if (!(config.period_s > 0.0) || !std::isfinite(config.period_s)) {
        throw std::invalid_argument("joint_coordination.period_s: must be above 0");
    }
}

void JointCoordination::reset() {
    filtered_wrench_N_.setZero();
}

JointTorques JointCoordination::step(const std::array<Eigen::Vector2d, 3> &w_link_N,
                                     const LinkEnds &ends_m, const Eigen::Vector2d &wrench_N) {
    filtered_wrench_N_ += filter_gain_ * (wrench_N - filtered_wrench_N_);

    const LinkJacobian j_elbow = PlanarArm::jacobian(ends_m, elbow);
    const LinkJacobian j_wrist = PlanarArm::jacobian(ends_m, wrist);
    const LinkJacobian j_hand = PlanarArm::jacobian(ends_m, hand);

    JointTorques torques;
    torques.tau_d_Nm = j_hand.transpose() * (2.0 * w_link_N[hand] - filtered_wrench_N_);
    const Eigen::Vector3d wanted_Nm(std::abs(j_elbow.col(0).dot(w_link_N[elbow])),
                                    std::abs(j_wrist.col(1).dot(w_link_N[wrist])),
                                    2.0 * std::abs(j_hand.col(2).dot(w_link_N[hand])));
    for (Eigen::Index joint = 0; joint < 3; ++joint) {
        // The order of the arguments lets NaN through, for the caller to see.
        torques.tau_max_Nm[joint] = std::min(wanted_Nm[joint], config_.torque_limit_Nm[joint]);
    }
    return torques;
}

} // namespace hpmc
