#include "hpmc/planar_arm.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hpmc {

namespace {

/// A wrist put on the edge of the ring on purpose comes back a rounding error beside it.
constexpr double edge_tolerance_m = 1e-9;

} // namespace

PlanarArm::PlanarArm(const PlanarArmConfig &config)
    : length_m_(config.length_m), reach_min_m_(std::abs(length_m_[0] - length_m_[1])),
      reach_max_m_(length_m_[0] + length_m_[1]) {
    if (!length_m_.allFinite() || !(length_m_.minCoeff() > 0.0)) {
        throw std::invalid_argument("arm.length_m: every link must be longer than 0");
    }
}

LinkEnds PlanarArm::link_ends(const Eigen::Vector3d &q_rad) const {
    LinkEnds ends;
    Eigen::Vector2d end = Eigen::Vector2d::Zero();
    double angle = 0.0;
    for (Eigen::Index i = 0; i < 3; ++i) {
        angle += q_rad[i];
        end += length_m_[i] * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        ends[static_cast<std::size_t>(i)] = end;
    }
    return ends;
}

LinkJacobian PlanarArm::jacobian(const LinkEnds &ends_m, Link link) {
    LinkJacobian jacobian = LinkJacobian::Zero();
    Eigen::Vector2d axis = Eigen::Vector2d::Zero();
    for (std::size_t joint = 0; joint <= link; ++joint) {
        const Eigen::Vector2d lever = ends_m[link] - axis;
        jacobian.col(static_cast<Eigen::Index>(joint)) = Eigen::Vector2d(-lever.y(), lever.x());
        axis = ends_m[joint];
    }
    return jacobian;
}

InverseKinematics PlanarArm::inverse(const Eigen::Vector2d &x_m, double phi_rad) const {
    const Eigen::Vector2d x_wrist =
        x_m - length_m_[2] * Eigen::Vector2d(std::cos(phi_rad), std::sin(phi_rad));
    const double distance = std::hypot(x_wrist.x(), x_wrist.y());
    // The order of the arguments lets NaN through.
    const double d = std::max(std::min(distance, reach_max_m_), reach_min_m_);

    const double l_a = length_m_[0];
    const double l_fa = length_m_[1];
    // Links of equal length fold the wrist onto the shoulder, where every angle serves.
    const double cos_beta = d == 0.0 ? 0.0 : (l_a * l_a + d * d - l_fa * l_fa) / (2.0 * l_a * d);
    const double beta = std::acos(std::max(std::min(cos_beta, 1.0), -1.0));
    const double bearing = std::atan2(x_wrist.y(), x_wrist.x());
    const double phi_a = bearing - beta;
    const Eigen::Vector2d x_elbow = l_a * Eigen::Vector2d(std::cos(phi_a), std::sin(phi_a));
    const Eigen::Vector2d forearm =
        d * Eigen::Vector2d(std::cos(bearing), std::sin(bearing)) - x_elbow;
    const double phi_f = std::atan2(forearm.y(), forearm.x());

    // In 0..pi by the choice of elbow; rounding at the edges and a turn between the bearings
    // undone.
    const double q2 = std::abs(std::remainder(phi_f - phi_a, 2.0 * M_PI));
    return {{phi_a, q2, phi_rad - phi_a - q2}, !(std::abs(d - distance) <= edge_tolerance_m)};
}

double manipulability(const LinkJacobian &jacobian) {
    return std::sqrt(std::max(0.0, (jacobian * jacobian.transpose()).determinant()));
}

} // namespace hpmc
