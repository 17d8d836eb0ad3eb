/**
 * Joint coordination: turns the wrenches of the region of attraction and the measured wrench into
 * desired and maximum torques of the joints (paper, eqs. 7 and 8).
 *
 * Links are ordered elbow, wrist, hand. N, N m, Hz. The measured wrench W is the force of the hand
 * on its environment; it is low-passed, since W unfiltered with one sample of delay alternates for
 * ever in stiff contact.
 */
#pragma once

#include <Eigen/Core>
#include <array>

#include "hpmc/planar_arm.h"

namespace hpmc {

struct JointCoordinationConfig {
    Eigen::Vector3d torque_limit_Nm{30.0, 20.0, 5.0}; ///< TA, above 0
    double wrench_cutoff_Hz = 100.0;                  ///< first-order low-pass, 20..200
    double period_s = 0.001;                          ///< SYNC period, above 0
};

struct JointTorques {
    Eigen::Vector3d tau_d_Nm;
    Eigen::Vector3d tau_max_Nm; ///< 0..TA
};

class JointCoordination {
  public:
    /// Throws std::invalid_argument when a parameter is out of range.
    explicit JointCoordination(const JointCoordinationConfig &config);

    /// Empties the low-pass.
    void reset();

    /// w_link_N: wrenches of the region of attraction; ends_m: measured link ends.
    JointTorques step(const std::array<Eigen::Vector2d, 3> &w_link_N, const LinkEnds &ends_m,
                      const Eigen::Vector2d &wrench_N);

    const Eigen::Vector2d &filtered_wrench_N() const { return filtered_wrench_N_; }

  private:
    JointCoordinationConfig config_;
    double filter_gain_;
    Eigen::Vector2d filtered_wrench_N_ = Eigen::Vector2d::Zero();
};

} // namespace hpmc
