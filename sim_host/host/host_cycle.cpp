#include "host/host_cycle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/node_configuration.h"

namespace hpmc {
namespace {

constexpr double kApproachParts = 2.0; ///< the blend, then the rise to full torque, as long each
constexpr std::int64_t kStatusPeriods = 10;      ///< NODE_STATUS at least this often
constexpr std::uint32_t kStopMarginPeriods = 30; ///< on top of the ramp of a quick stop

CanopenMasterConfig master_config(const RunConfig &config, TimeBase time_base) {
    const auto periods = [&](double seconds) {
        return static_cast<std::uint32_t>(
            std::lround(seconds * 1e6 / static_cast<double>(sync_period_us(config, time_base))));
    };
    CanopenMasterConfig master;
    master.configuration = node_configuration(config, time_base);
    master.heartbeat_periods =
        std::max(periods(static_cast<double>(config.bus.heartbeat_ms) * 1e-3), 1U);
    master.stop_periods = periods(config.joint.ramp_s) + kStopMarginPeriods;
    master.sync_first = config.bus.pipeline == 2;
    master.wall_clock = time_base == TimeBase::free_running;
    return master;
}

// Encoders saturate at the ranges of the object dictionary; a value beyond would be rejected.
constexpr double kTorqueRange_mNm = 32767.0; ///< 6071h and 6072h

std::int32_t position_inc(double increments) {
    return static_cast<std::int32_t>(std::clamp(
        std::round(increments), static_cast<double>(std::numeric_limits<std::int32_t>::min()),
        static_cast<double>(std::numeric_limits<std::int32_t>::max())));
}

std::int16_t torque_mNm(double torque_Nm) {
    return static_cast<std::int16_t>(
        std::clamp(std::round(torque_Nm * 1000.0), -kTorqueRange_mNm, kTorqueRange_mNm));
}

std::uint16_t torque_max_mNm(double torque_Nm) {
    return static_cast<std::uint16_t>(
        std::clamp(std::round(torque_Nm * 1000.0), 0.0, kTorqueRange_mNm));
}

bool all_finite(const HpmcOutput &out) {
    return out.x_d_m.allFinite() && out.q_d_rad.allFinite() && out.tau_d_Nm.allFinite() &&
           out.tau_max_Nm.allFinite();
}

/// 0 to 1 with zero slope at both ends.
double smooth_step(double fraction) {
    const double f = std::clamp(fraction, 0.0, 1.0);
    return f * f * (3.0 - 2.0 * f);
}

void copy(const Eigen::Vector2d &from, double (&to)[2]) {
    to[0] = from.x();
    to[1] = from.y();
}

void copy(const Eigen::Vector3d &from, double (&to)[3]) {
    for (int i = 0; i < 3; ++i) {
        to[i] = from[i];
    }
}

void copy(const std::array<Eigen::Vector2d, 3> &from, double (&to)[3][2]) {
    for (std::size_t i = 0; i < 3; ++i) {
        copy(from[i], to[i]);
    }
}

} // namespace

HostCycle::HostCycle(const RunConfig &config, TimeBase time_base)
    : config_(config), schedule_(config), master_(master_config(config, time_base)),
      controller_(config.hpmc), arm_(config.hpmc.arm),
      increments_per_rad_(static_cast<double>(config.joint.increments_per_revolution) /
                          (2.0 * M_PI)),
      delay_line_(static_cast<std::size_t>(config.bus.command_delay_ms)) {}

void HostCycle::begin_repetition() {
    master_.restart();
    periods_enabled_ = 0;
    stopping_ = false;
    q_rad_.setZero();
    std::fill(delay_line_.begin(), delay_line_.end(), Commands{});
    delay_next_ = 0;
    controller_.reset(config_.experiment.centre_m, q_rad_);
}

void HostCycle::raise(const std::string &why) {
    if (fault_.empty()) {
        char where[64];
        std::snprintf(where, sizeof where, " (repetition %lld, %.3f s into it)",
                      static_cast<long long>(point_.repetition),
                      static_cast<double>(point_.period) * kSyncPeriod_s);
        fault_ = why + where;
    }
}

/// Where the hand can be put: the wrist on the reachable ring, as the dynamic task saturates it.
Eigen::Vector2d HostCycle::reachable(const Eigen::Vector2d &x_m) const {
    const DynamicTaskConfig &task = config_.hpmc.dynamic_task;
    const double phi_rad =
        task.direction == TaskDirection::radial ? std::atan2(x_m.y(), x_m.x()) : task.w_t_rad;
    const InverseKinematics inverse = arm_.inverse(x_m, phi_rad);
    return inverse.saturated ? arm_.link_ends(inverse.q_rad)[hand] : x_m;
}

/// A target from outside acts during the reaches, until the next reach begins.
void HostCycle::choose_target(const std::optional<Eigen::Vector2d> &outside_m) {
    const bool reaching = point_.reach >= 0;
    if (!reaching || point_.reach_begins) {
        outside_m_.reset();
    }
    outside_began_ = outside_m.has_value() && reaching && !stopping_ && outside_m->allFinite();
    if (outside_began_) {
        outside_m_ = reachable(*outside_m);
        ++outside_count_;
    } else if (outside_m) {
        ++outside_refused_;
    }
    x_t_m_ = outside_m_.value_or(point_.x_t_m);
}

void HostCycle::read_joints() {
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        q_rad_[static_cast<Eigen::Index>(joint)] =
            master_.node(joint).position_inc / increments_per_rad_;
    }
}

/// Desired angles and fraction of T_max on the way from the measured pose to the first desired one.
Eigen::Vector3d HostCycle::approach(const Eigen::Vector3d &q_d_rad, double &torque_fraction) {
    const double elapsed_s = static_cast<double>(periods_enabled_) * kSyncPeriod_s;
    const double fraction = (elapsed_s - config_.joint.ramp_s) / config_.schedule.approach_s;
    if (fraction >= kApproachParts) {
        torque_fraction = 1.0;
        return q_d_rad;
    }
    const double reduced = config_.schedule.approach_torque;
    torque_fraction = reduced + (1.0 - reduced) * smooth_step(fraction - 1.0);
    const double bound = config_.hpmc.dynamic_task.joint_step_max_rad;
    const Eigen::Vector3d wanted = q_start_rad_ + smooth_step(fraction) * (q_d_rad - q_start_rad_);
    q_blend_rad_ += (wanted - q_blend_rad_).cwiseMax(-bound).cwiseMin(bound);
    return q_blend_rad_;
}

HostCycle::Commands HostCycle::command(const Eigen::Vector3d &q_d_rad, const HpmcOutput &out,
                                       double torque_fraction) {
    Commands commands;
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const auto at = static_cast<Eigen::Index>(joint);
        commands[joint].position_inc = position_inc(q_d_rad[at] * increments_per_rad_);
        commands[joint].torque_mNm = torque_mNm(out.tau_d_Nm[at] * torque_fraction);
        commands[joint].torque_max_mNm = torque_max_mNm(out.tau_max_Nm[at] * torque_fraction);
    }
    return commands;
}

HostCycle::Commands HostCycle::delayed(const Commands &commands) {
    if (delay_line_.empty()) {
        return commands;
    }
    const Commands oldest = delay_line_[delay_next_];
    delay_line_[delay_next_] = commands;
    delay_next_ = (delay_next_ + 1) % delay_line_.size();
    return oldest;
}

RunPhase HostCycle::phase() const {
    switch (master_.stage()) {
    case MasterStage::reset:
    case MasterStage::boot:
        return RunPhase::boot;
    case MasterStage::configure:
    case MasterStage::start:
        return RunPhase::configure;
    case MasterStage::enable:
        return RunPhase::enable;
    case MasterStage::enabled:
        return point_.reach >= 0 ? RunPhase::reaches : RunPhase::approach;
    case MasterStage::stopping:
    case MasterStage::stopped:
        break;
    }
    return RunPhase::stop;
}

void HostCycle::step(const HostCycleInput &input, HostCycleOutput &output) {
    point_ = schedule_.at(input.period);
    if (point_.period == 0) {
        begin_repetition();
    } else if (const std::string &why = master_.receive(input.frames, input.frame_count);
               !why.empty()) {
        raise(why);
    }
    choose_target(input.target_m);
    read_joints();

    HpmcOutput out{};
    Eigen::Vector3d q_d_rad = q_rad_;
    Commands commands{};
    if (!operating()) {
        // Hold what is measured, without torque: nodes accept to be enabled only close by.
        out.q_d_rad = q_rad_;
        commands = command(q_rad_, out, 0.0);
        std::fill(delay_line_.begin(), delay_line_.end(), commands);
    } else {
        if (periods_enabled_ == 0) {
            q_start_rad_ = q_blend_rad_ = q_rad_;
            controller_.reset(arm_.link_ends(q_rad_)[hand], q_rad_);
        }
        out = controller_.step({x_t_m_, q_rad_, input.wrench_N});
        if (!all_finite(out)) {
            raise("a layer of the host gave a value that is no finite number");
            out = HpmcOutput{};
            out.q_d_rad = q_rad_;
        }
        double torque_fraction = 1.0;
        q_d_rad = point_.reach < 0 ? approach(out.q_d_rad, torque_fraction) : out.q_d_rad;
        commands = delayed(command(q_d_rad, out, torque_fraction));
        ++periods_enabled_;
    }

    if (point_.reach == 0 && point_.reach_begins && fault_.empty()) {
        if (!operating()) {
            raise("the nodes were not enabled within schedule.setup_s");
        } else if ((arm_.link_ends(q_rad_)[hand] - schedule_.target_m(0)).norm() >
                   config_.schedule.approach_tolerance_m) {
            raise("the approach did not reach home within schedule.setup_s");
        }
    }
    if (!stopping_ && (point_.stopping || stop_requested_ || !fault_.empty())) {
        stopping_ = true;
        master_.stop();
    }
    output.frame_count = master_.compose(commands, output.frames);
    output.finished = master_.stopped() && (stop_requested_ || !fault_.empty());
    fill_state(input, out, q_d_rad);
}

void HostCycle::fill_state(const HostCycleInput &input, const HpmcOutput &out,
                           const Eigen::Vector3d &q_d_rad) {
    state_.utime = input.period * kSyncPeriod_us;
    state_.seq = input.period;
    state_.repetition = static_cast<std::int32_t>(point_.repetition);
    state_.reach = point_.reach;
    state_.target = point_.target;
    state_.phase = static_cast<std::int32_t>(phase());
    copy(x_t_m_, state_.x_t_m);
    copy(out.x_d_m, state_.x_d_m);
    copy(out.v_d_m_s, state_.v_d_m_s);
    state_.phi_rad = out.phi_rad;
    copy(q_d_rad, state_.q_d_rad);
    copy(q_rad_, state_.q_rad);
    copy(out.x_link_d_m, state_.x_link_d_m);
    copy(out.x_link_m, state_.x_link_m);
    copy(out.w_link_N, state_.w_link_N);
    copy(out.wrench_N, state_.wrench_N);
    copy(out.tau_d_Nm, state_.tau_d_Nm);
    copy(out.tau_max_Nm, state_.tau_max_Nm);
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        state_.tau_Nm[joint] = master_.node(joint).torque_mNm / 1000.0;
        state_.statusword[joint] = static_cast<std::int16_t>(master_.node(joint).statusword);
    }
    state_.saturated = out.saturated ? 1 : 0;
}

bool HostCycle::node_status(std::size_t joint, hpmc_lcm::node_status_t &status) {
    if (state_.seq % kStatusPeriods != 0 && !master_.news(joint)) {
        return false;
    }
    const NodeView &node = master_.node(joint);
    status.utime = state_.utime;
    status.seq = status_seq_[joint]++;
    status.node_id = static_cast<std::int32_t>(joint + 1);
    status.nmt_state = node.nmt_state;
    status.statusword = node.statusword;
    status.mode_display = node.mode_display;
    status.limit_reasons = node.limit_reasons;
    status.missed_sync = node.missed_sync;
    status.temperature_dC = node.temperature_dC;
    status.position_inc = node.position_inc;
    status.torque_mNm = node.torque_mNm;
    status.emcy_code = node.emcy_code;
    status.error_register = node.error_register;
    status.emcy_count = static_cast<std::int32_t>(node.emcy_count);
    return true;
}

} // namespace hpmc
