#include "host/encoder_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "host/node_configuration.h"

namespace hpmc {
namespace {

constexpr std::int8_t kCyclicSynchronousTorque = 10;
constexpr double kSettle_s = 0.2; ///< longer than the ramp of the output bound
constexpr double kPush_s = 1.0;   ///< torque rises to its largest
constexpr double kHold_s = 0.3;   ///< and stays there
constexpr double kBrake_s = 0.3;
constexpr double kRest_s = 0.1;
constexpr std::uint32_t kStopMarginPeriods = 30;

CanopenMasterConfig master_config(const RunConfig &config) {
    const double sync_Hz = static_cast<double>(config.bench.sync_Hz);
    const auto periods = [&](double seconds) {
        return static_cast<std::uint32_t>(std::lround(seconds * sync_Hz));
    };
    CanopenMasterConfig master;
    master.configuration = node_configuration(config, TimeBase::free_running);
    master.heartbeat_periods =
        std::max(periods(static_cast<double>(config.bus.heartbeat_ms) * 1e-3), 1U);
    master.mode = kCyclicSynchronousTorque;
    master.stop_periods = periods(config.joint.ramp_s) + kStopMarginPeriods;
    master.sync_first = true;
    master.wall_clock = true;
    return master;
}

template <class... Values> std::string text(const char *format, Values... values) {
    char buffer[240];
    std::snprintf(buffer, sizeof buffer, format, values...);
    return buffer;
}

} // namespace

EncoderCheck::EncoderCheck(const RunConfig &config)
    : config_(config), master_(master_config(config)), home_rad_(home_pose_rad(config)),
      period_s_(1.0 / static_cast<double>(config.bench.sync_Hz)) {}

bool EncoderCheck::lasted(double seconds) const {
    return static_cast<double>(periods_) * period_s_ >= seconds;
}

void EncoderCheck::enter(Stage stage) {
    stage_ = stage;
    periods_ = 0;
}

void EncoderCheck::raise(const std::string &why) {
    if (fault_.empty()) {
        fault_ = why + " (encoder check)";
    }
}

double EncoderCheck::angle_rad(std::size_t joint) const {
    return master_.node(joint).position_inc * 2.0 * M_PI /
           static_cast<double>(config_.joint.increments_per_revolution);
}

void EncoderCheck::check_posture() {
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const double home = home_rad_[static_cast<Eigen::Index>(joint)];
        if (std::abs(angle_rad(joint) - home) > config_.bench.check_tolerance_rad) {
            raise(text("encoder of joint %zu reads %.3f rad, home is %.3f rad: further than "
                       "bench.check_tolerance_rad, %g; bring the arm home or set the offset",
                       joint + 1, angle_rad(joint), home, config_.bench.check_tolerance_rad));
        }
        start_rad_[joint] = angle_rad(joint);
    }
}

std::string EncoderCheck::who_moved_instead() const {
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        if (joint != joint_ && std::abs(moved_rad(joint)) >= config_.bench.check_motion_rad) {
            return text("; joint %zu moved instead", joint + 1);
        }
    }
    return "";
}

void EncoderCheck::push() {
    const double limit_Nm = config_.bench.check_torque_Nm[static_cast<Eigen::Index>(joint_)];
    const double moved = moved_rad(joint_);
    if (moved <= -config_.bench.check_motion_rad) {
        raise(text("encoder of joint %zu counts against the torque of its motor: %.4f rad under "
                   "%.2f N m; turn the sign of one of them",
                   joint_ + 1, moved, torque_Nm_));
    } else if (moved >= config_.bench.check_motion_rad) {
        findings_[joint_] = {moved, torque_Nm_};
        torque_Nm_ = -torque_Nm_;
        enter(Stage::brake);
    } else if (lasted(kPush_s + kHold_s)) {
        raise(text("joint %zu did not move under %.2f N m: motor, brake or encoder%s", joint_ + 1,
                   torque_Nm_, who_moved_instead().c_str()));
    } else {
        const double fraction = static_cast<double>(periods_) * period_s_ / kPush_s;
        torque_Nm_ = limit_Nm * std::min(fraction, 1.0);
    }
}

/// Against the motion until the joint stands.
void EncoderCheck::brake() {
    if (lasted(kBrake_s) || (periods_ > 1 && angle_rad(joint_) <= last_rad_)) {
        torque_Nm_ = 0.0;
        enter(Stage::rest);
    }
}

void EncoderCheck::check_motion() {
    if (std::abs(moved_rad(joint_)) > config_.bench.check_motion_max_rad) {
        raise(text("joint %zu moved %.3f rad, more than bench.check_motion_max_rad, %g", joint_ + 1,
                   moved_rad(joint_), config_.bench.check_motion_max_rad));
    }
}

void EncoderCheck::advance() {
    switch (stage_) {
    case Stage::bring_up:
        if (master_.stage() == MasterStage::enabled) {
            enter(Stage::settle);
        }
        break;
    case Stage::settle:
        if (lasted(kSettle_s)) {
            check_posture();
            enter(Stage::push);
        }
        break;
    case Stage::push:
        push();
        check_motion();
        break;
    case Stage::brake:
        brake();
        check_motion();
        break;
    case Stage::rest:
        check_motion();
        if (lasted(kRest_s)) {
            joint_ = std::min(joint_ + 1, kJoints);
            if (joint_ == kJoints) {
                enter(Stage::stop);
                master_.stop();
            } else {
                for (std::size_t joint = 0; joint < kJoints; ++joint) {
                    start_rad_[joint] = angle_rad(joint);
                }
                enter(Stage::push);
            }
        }
        break;
    case Stage::stop:
        break;
    }
}

void EncoderCheck::step(const can_frame_t *frames, std::size_t count, HostCycleOutput &output) {
    const std::string &why = first_ ? fault_ : master_.receive(frames, count);
    first_ = false;
    if (!why.empty()) {
        raise(why);
    }
    if (fault_.empty() && !stop_requested_) {
        advance();
    }
    if ((!fault_.empty() || stop_requested_) && stage_ != Stage::stop) {
        torque_Nm_ = 0.0;
        enter(Stage::stop);
        master_.stop();
    }
    if (joint_ < kJoints) {
        last_rad_ = angle_rad(joint_);
    }
    std::array<JointCommand, kJoints> commands{};
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        commands[joint].position_inc = master_.node(joint).position_inc;
        if (joint == joint_ && stage_ != Stage::stop) {
            commands[joint].torque_mNm = static_cast<std::int16_t>(std::lround(torque_Nm_ * 1e3));
            commands[joint].torque_max_mNm = static_cast<std::uint16_t>(
                std::lround(config_.bench.check_torque_Nm[static_cast<Eigen::Index>(joint)] * 1e3));
        }
    }
    output.frame_count = master_.compose(commands, output.frames);
    output.finished = stage_ == Stage::stop && master_.stopped();
    ++periods_;
}

std::string EncoderCheck::to_json() const {
    std::string json = "\"encoder_check\": [";
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        json += text("%s{\"moved_rad\": %.5f, \"torque_Nm\": %.3f}", joint == 0 ? "" : ", ",
                     findings_[joint].moved_rad, findings_[joint].torque_Nm);
    }
    return json + "]";
}

} // namespace hpmc
