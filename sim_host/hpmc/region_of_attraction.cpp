#include "hpmc/region_of_attraction.h"

#include <cmath>
#include <stdexcept>

namespace hpmc {

namespace {

constexpr double knee = 0.95; ///< of x_b: where the linear part ends
const double shape = (1.0 - knee) / (2.0 * M_PI);

} // namespace

RegionOfAttraction::RegionOfAttraction(const RegionOfAttractionConfig &config) : config_(config) {
    if (!(config.saturation_m > 0.0) || !std::isfinite(config.saturation_m)) {
        throw std::invalid_argument("region_of_attraction.saturation_m: must be above 0");
    }
    if (!config.stiffness_N_m.allFinite() || !(config.stiffness_N_m.minCoeff() > 0.0)) {
        throw std::invalid_argument("region_of_attraction.stiffness_N_m: must be above 0");
    }
    const Eigen::Vector3d force_at_saturation_N = config.stiffness_N_m * config.saturation_m;
    // A hair of slack: K0 x_b computed here and F_max written in decimals differ in the last bit.
    if (!config.force_max_N.allFinite() ||
        !((config.force_max_N - force_at_saturation_N * (1.0 - 1e-9)).minCoeff() >= 0.0)) {
        throw std::invalid_argument(
            "region_of_attraction.force_max_N: must be at least stiffness_N_m * saturation_m");
    }
}

double RegionOfAttraction::force_N(Link link, double distance_m) const {
    const auto i = static_cast<Eigen::Index>(link);
    const double stiffness_N_m = config_.stiffness_N_m[i];
    const double x_b = config_.saturation_m;
    if (distance_m <= knee * x_b) {
        return stiffness_N_m * distance_m;
    }
    const double f_0 = knee * stiffness_N_m * x_b;
    const double delta_f = config_.force_max_N[i] - f_0;
    return delta_f / 2.0 * (std::tanh((distance_m - x_b) / (shape * x_b) + M_PI) + 1.0) + f_0;
}

std::array<Eigen::Vector2d, 3> RegionOfAttraction::step(const LinkEnds &desired_m,
                                                        const LinkEnds &actual_m) const {
    std::array<Eigen::Vector2d, 3> wrench_N;
    for (const Link link : {elbow, wrist, hand}) {
        const Eigen::Vector2d error_m = desired_m[link] - actual_m[link];
        const double distance_m = std::hypot(error_m.x(), error_m.y());
        wrench_N[link] = distance_m == 0.0
                             ? Eigen::Vector2d(Eigen::Vector2d::Zero())
                             : Eigen::Vector2d(force_N(link, distance_m) / distance_m * error_m);
    }
    return wrench_N;
}

} // namespace hpmc
