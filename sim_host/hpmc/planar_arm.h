/**
 * Kinematics of the planar three-link arm: forward, Jacobians of every link end, inverse.
 *
 * Angles are relative and counter-clockwise positive, q1 from +x; shoulder at the origin; SI units.
 * The inverse takes the elbow on the right of the line from shoulder to wrist (q2 >= 0), as the
 * paper's closed form does (eqs. 4 and 5, with erratum 2 of docs/theory.md).
 */
#pragma once

#include <Eigen/Core>
#include <array>

namespace hpmc {

/// Index of a link, named by its far end: arm, forearm, hand.
enum Link : std::size_t { elbow = 0, wrist = 1, hand = 2 };

/// Positions of elbow, wrist and hand, in m.
using LinkEnds = std::array<Eigen::Vector2d, 3>;

using LinkJacobian = Eigen::Matrix<double, 2, 3>;

struct PlanarArmConfig {
    Eigen::Vector3d length_m{0.282, 0.269, 0.044}; ///< arm, forearm, hand; each above 0
};

struct InverseKinematics {
    Eigen::Vector3d q_rad; ///< sum is phi; q2 in 0..pi, the others in no particular range
    bool saturated;        ///< the wrist was out of reach and was put on the reachable ring
};

class PlanarArm {
  public:
    /// Throws std::invalid_argument unless every length is positive and finite.
    explicit PlanarArm(const PlanarArmConfig &config);

    LinkEnds link_ends(const Eigen::Vector3d &q_rad) const;

    /// Geometric Jacobian of one link end; columns beyond the link are zero.
    static LinkJacobian jacobian(const LinkEnds &ends_m, Link link);

    /// Joint angles that put the hand on x_m with orientation phi_rad. Never NaN for finite input:
    /// a wrist out of reach is moved along its own direction to the nearest reachable distance.
    InverseKinematics inverse(const Eigen::Vector2d &x_m, double phi_rad) const;

    const Eigen::Vector3d &length_m() const { return length_m_; }
    double wrist_reach_min_m() const { return reach_min_m_; }
    double wrist_reach_max_m() const { return reach_max_m_; }

  private:
    Eigen::Vector3d length_m_;
    double reach_min_m_;
    double reach_max_m_;
};

/// Yoshikawa's manipulability sqrt(det(J J')), in m^2.
double manipulability(const LinkJacobian &jacobian);

} // namespace hpmc
