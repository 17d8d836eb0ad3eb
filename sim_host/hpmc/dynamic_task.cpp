#include "hpmc/dynamic_task.h"

#include <boost/math/tools/minima.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace hpmc {

namespace {

constexpr double turn_rad = 2.0 * M_PI;
constexpr double rest_speed_m_s = 1e-3;
constexpr double rest_distance_m = 1e-6;

constexpr unsigned probes = 24;
constexpr double probe_spacing_rad = turn_rad / probes;
/// Another minimum must be that much better before the hand turns to it: no to and fro at a tie.
constexpr double probe_gain = 0.99;
constexpr int minimiser_bits = 22;
constexpr std::uintmax_t minimiser_iterations = 30;
constexpr int bisections = 10;

double nearest_angle(double angle_rad, double reference_rad) {
    return reference_rad + std::remainder(angle_rad - reference_rad, turn_rad);
}

/// Orientations of the hand that leave the wrist within reach: centre +- half_width.
struct ReachableArc {
    double centre_rad;
    double half_width_rad; ///< pi: all of them

    double clamp(double phi_rad) const {
        const double offset = std::remainder(phi_rad - centre_rad, turn_rad);
        return centre_rad + std::max(std::min(offset, half_width_rad), -half_width_rad);
    }
};

ReachableArc reachable_arc(const PlanarArm &arm, const Eigen::Vector2d &x_m) {
    const double hand_m = arm.length_m()[2];
    const double distance_m = std::hypot(x_m.x(), x_m.y());
    const double bearing_rad = std::atan2(x_m.y(), x_m.x());
    // |X_W|^2 = |X|^2 + l_H^2 - 2 |X| l_H cos(phi - bearing), solved for the cosine at both edges.
    const auto edge_cosine = [&](double reach_m) {
        return ((distance_m - reach_m) * ((distance_m + reach_m) / distance_m) +
                hand_m * (hand_m / distance_m)) /
               (2.0 * hand_m);
    };
    if (distance_m + hand_m > arm.wrist_reach_max_m()) {
        const double cosine = edge_cosine(arm.wrist_reach_max_m());
        return {bearing_rad, std::acos(std::max(std::min(cosine, 1.0), -1.0))};
    }
    if (std::abs(distance_m - hand_m) < arm.wrist_reach_min_m()) {
        if (distance_m == 0.0) {
            return {bearing_rad, M_PI};
        }
        const double cosine = edge_cosine(arm.wrist_reach_min_m());
        return {bearing_rad + M_PI, std::acos(std::max(std::min(-cosine, 1.0), -1.0))};
    }
    return {bearing_rad, M_PI};
}

} // namespace

DynamicTask::DynamicTask(const DynamicTaskConfig &config, const PlanarArmConfig &arm)
    : config_(config), arm_(arm), direction_(config.direction), w_t_rad_(config.w_t_rad) {
    if (!std::isfinite(config.w_t_rad)) {
        throw std::invalid_argument("dynamic_task.w_t_rad: must be finite");
    }
    if (!(config.joint_step_max_rad > 0.0) || !std::isfinite(config.joint_step_max_rad)) {
        throw std::invalid_argument("dynamic_task.joint_step_max_rad: must be above 0");
    }
    if (config.posture == Posture::optimal &&
        !(arm.length_m[2] < std::min(arm.length_m[0], arm.length_m[1]))) {
        throw std::invalid_argument(
            "dynamic_task.posture: optimal needs a hand shorter than arm and forearm");
    }
}

void DynamicTask::reset(const Eigen::Vector3d &q_rad) {
    q_d_rad_ = q_rad;
    phi_optimal_rad_ = q_rad.sum();
    direction_ = config_.direction;
    w_t_rad_ = config_.w_t_rad;
    probe_ = 0;
}

void DynamicTask::set_direction(double w_t_rad) {
    direction_ = TaskDirection::fixed;
    w_t_rad_ = w_t_rad;
}

void DynamicTask::follow_direction(const Eigen::Vector2d &x_d_m, const Eigen::Vector2d &v_d_m_s) {
    switch (direction_) {
    case TaskDirection::fixed:
        break;
    case TaskDirection::radial:
        if (!(std::hypot(x_d_m.x(), x_d_m.y()) < rest_distance_m)) {
            w_t_rad_ = std::atan2(x_d_m.y(), x_d_m.x());
        }
        break;
    case TaskDirection::motion:
        if (!(std::hypot(v_d_m_s.x(), v_d_m_s.y()) < rest_speed_m_s)) {
            w_t_rad_ = std::atan2(v_d_m_s.y(), v_d_m_s.x());
        }
        break;
    }
}

double DynamicTask::interaction_cost_m2(const PlanarArm &arm, const Eigen::Vector2d &x_m,
                                        double phi_rad, double w_t_rad) {
    const LinkEnds ends_m = arm.link_ends(arm.inverse(x_m, phi_rad).q_rad);
    const Eigen::Vector2d w_t(std::cos(w_t_rad), std::sin(w_t_rad));
    return (PlanarArm::jacobian(ends_m, hand).transpose() * w_t).squaredNorm();
}

double DynamicTask::optimal_orientation(const Eigen::Vector2d &x_d_m) {
    const ReachableArc arc = reachable_arc(arm_, x_d_m);
    const auto cost_m2 = [&](double phi_rad) {
        return interaction_cost_m2(arm_, x_d_m, arc.clamp(phi_rad), w_t_rad_);
    };
    // The cost has up to two minima. One orientation of a coarse fan is tried a step, and the
    // closed form always, so that a better minimum is found within `probes` steps at the cost of
    // two calls.
    const double current_m2 = cost_m2(phi_optimal_rad_);
    const double probe_rad = probe_ * probe_spacing_rad;
    probe_ = (probe_ + 1) % probes;
    if (cost_m2(probe_rad) < probe_gain * current_m2) {
        phi_optimal_rad_ = probe_rad;
    } else if (cost_m2(w_t_rad_) < current_m2) {
        phi_optimal_rad_ = w_t_rad_;
    }
    std::uintmax_t iterations = minimiser_iterations;
    const auto [phi_rad, refined_m2] = boost::math::tools::brent_find_minima(
        cost_m2, phi_optimal_rad_ - probe_spacing_rad, phi_optimal_rad_ + probe_spacing_rad,
        minimiser_bits, iterations);
    if (refined_m2 < cost_m2(phi_optimal_rad_)) {
        phi_optimal_rad_ = phi_rad;
    }
    phi_optimal_rad_ = arc.clamp(phi_optimal_rad_);
    return phi_optimal_rad_;
}

/// The turn of the hand from where it is to phi_rad: the shorter way, unless it leads out of reach.
double DynamicTask::way_to(double phi_rad, const Eigen::Vector2d &x_d_m) const {
    const double phi_now_rad = q_d_rad_.sum();
    if (config_.posture == Posture::optimal) {
        const ReachableArc arc = reachable_arc(arm_, x_d_m);
        if (arc.half_width_rad < M_PI) {
            return std::remainder(phi_rad - arc.centre_rad, turn_rad) -
                   std::remainder(phi_now_rad - arc.centre_rad, turn_rad);
        }
    }
    return std::remainder(phi_rad - phi_now_rad, turn_rad);
}

DynamicTask::Candidate DynamicTask::candidate(const Eigen::Vector2d &x_d_m, double phi_rad,
                                              const Eigen::Vector3d &q_measured_rad) const {
    const InverseKinematics inverse = arm_.inverse(x_d_m, phi_rad);
    Candidate result{inverse.q_rad, inverse.saturated, false};
    for (Eigen::Index i = 0; i < 3; ++i) {
        result.q_rad[i] = nearest_angle(result.q_rad[i], q_measured_rad[i]);
    }
    result.within_step =
        (result.q_rad - q_d_rad_).cwiseAbs().maxCoeff() <= config_.joint_step_max_rad;
    return result;
}

DesiredPosture DynamicTask::step(const Eigen::Vector2d &x_d_m, const Eigen::Vector2d &v_d_m_s,
                                 const Eigen::Vector3d &q_measured_rad) {
    follow_direction(x_d_m, v_d_m_s);
    const double phi_wanted_rad =
        config_.posture == Posture::optimal ? optimal_orientation(x_d_m) : w_t_rad_;

    Candidate best = candidate(x_d_m, phi_wanted_rad, q_measured_rad);
    if (!best.within_step) {
        const double phi_now_rad = q_d_rad_.sum();
        const double limit_rad = 3.0 * config_.joint_step_max_rad; // the angles sum up to phi
        const double way_rad =
            std::max(std::min(way_to(phi_wanted_rad, x_d_m), limit_rad), -limit_rad);
        double feasible = 0.0;
        double infeasible = 1.0;
        Candidate turned = candidate(x_d_m, phi_now_rad, q_measured_rad);
        if (turned.within_step) {
            best = turned;
            for (int i = 0; i < bisections; ++i) {
                const double middle = 0.5 * (feasible + infeasible);
                turned = candidate(x_d_m, phi_now_rad + middle * way_rad, q_measured_rad);
                if (turned.within_step) {
                    feasible = middle;
                    best = turned;
                } else {
                    infeasible = middle;
                }
            }
        }
    }
    const Eigen::Vector3d step_rad = best.q_rad - q_d_rad_;
    q_d_rad_ += step_rad.cwiseMax(-config_.joint_step_max_rad).cwiseMin(config_.joint_step_max_rad);
    return {q_d_rad_, q_d_rad_.sum(), best.saturated};
}

} // namespace hpmc
