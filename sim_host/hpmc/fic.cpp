#include "hpmc/fic.h"

#include <algorithm>
#include <cmath>

namespace hpmc {

Fic::Fic(const FicConfig &config)
    : config_(config), stall_ticks_(std::lround(config.stall_time_s / config.period_s)) {}

void Fic::reset(double position) {
    *this = Fic(config_);
    turning_position_ = position;
}

void Fic::latch(double excursion, double profile_force) {
    excursion_max_ = excursion;
    force_max_ = profile_force;
}

bool Fic::body_approaches(double error, double position) {
    const double advance = position - turning_position_;
    const bool onward = direction_ * advance > 0.0;
    if (onward || std::abs(advance) > config_.delta) {
        direction_ = advance > 0.0 ? 1 : -1;
        turning_position_ = position;
        rest_ticks_ = 0;
    }
    ++rest_ticks_;
    return rest_ticks_ <= stall_ticks_ && error * direction_ > 0.0;
}

bool Fic::error_shrinks(double excursion, bool crossed_zero) {
    if (crossed_zero) {
        return false;
    }
    if (!converging_) {
        turning_excursion_ = excursion;
        return excursion < excursion_max_ - config_.delta;
    }
    turning_excursion_ = std::min(excursion, turning_excursion_);
    return !(excursion > turning_excursion_ + config_.delta);
}

double Fic::step(double error, double position, double profile_force) {
    const double excursion = std::abs(error);
    const int side = error < 0.0 ? -1 : 1;
    const bool crossed_zero = side != side_;
    if (crossed_zero) {
        side_ = side;
        latch(excursion, profile_force);
    }
    const bool was_converging = converging_;
    if (config_.phase_rule == PhaseRule::body_motion) {
        converging_ = body_approaches(error, position);
        if (!converging_ || excursion > excursion_max_) {
            latch(excursion, profile_force);
        }
    } else {
        converging_ = error_shrinks(excursion, crossed_zero);
        if (!converging_ && (was_converging || excursion >= excursion_max_)) {
            latch(excursion, profile_force);
        }
    }
    if (!converging_) {
        return side * profile_force;
    }
    if (!(excursion_max_ > 0.0)) {
        return 0.0;
    }
    const double spring = 2.0 * force_max_ / excursion_max_ * (excursion - excursion_max_ / 2.0);
    return side * std::min(spring, profile_force);
}

} // namespace hpmc
