#include "host/telemetry.h"

#include <algorithm>
#include <cstdlib>
#include <gnu/libc-version.h>

#include "link/motor_node_od.h"
#include "version.h"

namespace hpmc {
namespace {

constexpr std::int64_t kRunInfoPeriod_us = 1000000;
constexpr std::int32_t kWaypoint = -2; ///< arm_target_t.target

#ifdef CONTROL_FIXED_POINT
constexpr const char *kJointNumbers = "fixed";
#else
constexpr const char *kJointNumbers = "float";
#endif

hpmc_lcm::can_frame_t to_lcm(const can_frame_t &frame) {
    hpmc_lcm::can_frame_t message{};
    message.id = static_cast<std::int16_t>(frame.id);
    message.sender = static_cast<std::int8_t>(sender_of(frame));
    message.len = static_cast<std::int8_t>(frame.len);
    std::copy_n(frame.data, sizeof frame.data, message.data);
    return message;
}

} // namespace

hpmc_lcm::run_info_t make_run_info(const RunConfig &config, const std::string &mode) {
    hpmc_lcm::run_info_t info{};
    const char *tunables = std::getenv("GLIBC_TUNABLES");
    info.mode = mode;
    info.seed = config.experiment.seed;
    info.config_toml = to_toml(config);
    info.git = HPMC_GIT_HASH;
    info.protocol_hash = motor_node_od::kProtocolHash;
    info.libm = std::string("glibc ") + gnu_get_libc_version() +
                " GLIBC_TUNABLES=" + (tunables != nullptr ? tunables : "");
    info.build = std::string("gcc ") + __VERSION__ + " -ffp-contract=off, joint controllers in " +
                 kJointNumbers;
    return info;
}

Telemetry::Telemetry(const RunConfig &config, const std::string &mode, LogLevel level)
    : level_(level), run_info_(make_run_info(config, mode)) {}

bool Telemetry::run_info_due(std::int64_t utime) {
    if (run_info_sent_ && utime % kRunInfoPeriod_us != 0) {
        return false;
    }
    run_info_.utime = utime;
    run_info_.seq += run_info_sent_ ? 1 : 0;
    run_info_sent_ = true;
    return true;
}

bool Telemetry::target_changed(const HostCycle &cycle) {
    const SchedulePoint &point = cycle.schedule_point();
    if (!point.target_changes) {
        return false;
    }
    arm_target_.utime = cycle.state().utime;
    arm_target_.x_t_m[0] = point.x_t_m.x();
    arm_target_.x_t_m[1] = point.x_t_m.y();
    const bool home = point.target != 0 && point.reach % 2 != 0;
    arm_target_.target = home ? 0 : (point.target != 0 ? point.target : kWaypoint);
    // Numbered by the schedule, so that it grows through repetitions whoever runs them, and by the
    // targets from outside in between.
    arm_target_.seq =
        point.target_seq + cycle.outside_targets() - (cycle.outside_target_began() ? 1 : 0);
    return true;
}

bool Telemetry::outside_target_began(const HostCycle &cycle) {
    if (!cycle.outside_target_began()) {
        return false;
    }
    arm_target_.utime = cycle.state().utime;
    std::copy_n(cycle.state().x_t_m, 2, arm_target_.x_t_m);
    arm_target_.target = kOutsideTarget;
    arm_target_.seq = cycle.schedule_point().target_seq + cycle.outside_targets();
    return true;
}

void Telemetry::collect_frames(const hpmc_lcm::hpmc_state_t &state, const PeriodFrames &from_nodes,
                               const HostCycleOutput &from_host) {
    can_frames_.utime = state.utime;
    can_frames_.seq = state.seq;
    can_frames_.frames.clear();
    std::transform(from_nodes.frames.begin(),
                   from_nodes.frames.begin() + static_cast<std::ptrdiff_t>(from_nodes.count),
                   std::back_inserter(can_frames_.frames), to_lcm);
    std::transform(from_host.frames.begin(),
                   from_host.frames.begin() + static_cast<std::ptrdiff_t>(from_host.frame_count),
                   std::back_inserter(can_frames_.frames), to_lcm);
    can_frames_.count = static_cast<std::int32_t>(can_frames_.frames.size());
}

} // namespace hpmc
