#include "hpmc/elastic_band.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hpmc {

namespace {

/// The mass knows its own position exactly, so every motion counts.
FicConfig exact_motion(const ElasticBandConfig &config) {
    FicConfig fic;
    fic.phase_rule = config.phase_rule;
    fic.delta = 0.0;
    fic.period_s = config.period_s;
    return fic;
}

} // namespace

ElasticBand::ElasticBand(const ElasticBandConfig &config)
    : config_(config), fic_along_(exact_motion(config)), fic_normal_(exact_motion(config)) {
    if (!(config.acceleration_max_m_s2 > 0.0) || !std::isfinite(config.acceleration_max_m_s2)) {
        throw std::invalid_argument("elastic_band.acceleration_max_m_s2: must be above 0");
    }
    if (!(config.saturation_m > 0.0) || !std::isfinite(config.saturation_m)) {
        throw std::invalid_argument("elastic_band.saturation_m: must be above 0");
    }
    if (!(config.period_s > 0.0) || !std::isfinite(config.period_s)) {
        throw std::invalid_argument("elastic_band.period_s: must be above 0");
    }
}

void ElasticBand::reset(const Eigen::Vector2d &x_m) {
    x_d_m_ = x_m;
    v_d_m_s_.setZero();
    freeze_frame(x_m);
}

void ElasticBand::freeze_frame(const Eigen::Vector2d &x_t_m) {
    x_t_m_ = x_t_m;
    const Eigen::Vector2d way = x_t_m - x_d_m_;
    const double distance_m = std::hypot(way.x(), way.y());
    along_ = distance_m == 0.0 ? Eigen::Vector2d::UnitX() : Eigen::Vector2d(way / distance_m);
    normal_ = Eigen::Vector2d(-along_.y(), along_.x());
    // The axes measure position from the target, so position = -error.
    fic_along_.reset(-along_.dot(way));
    fic_normal_.reset(-normal_.dot(way));
}

double ElasticBand::pull_m_s2(Fic &fic, double error_m) const {
    const double a_max = config_.acceleration_max_m_s2;
    const double slope = a_max / config_.saturation_m;
    // The order of the arguments lets NaN through.
    return fic.step(error_m, -error_m, std::min(slope * std::abs(error_m), a_max));
}

void ElasticBand::step(const Eigen::Vector2d &x_t_m) {
    if (x_t_m != x_t_m_) {
        freeze_frame(x_t_m);
    }
    const Eigen::Vector2d error_m = x_t_m_ - x_d_m_;
    const double along_m_s2 = pull_m_s2(fic_along_, along_.dot(error_m));
    const double normal_m_s2 = pull_m_s2(fic_normal_, normal_.dot(error_m));
    v_d_m_s_ += config_.period_s * (along_m_s2 * along_ + normal_m_s2 * normal_);
    x_d_m_ += config_.period_s * v_d_m_s_;
}

} // namespace hpmc
