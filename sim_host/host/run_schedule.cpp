#include "host/run_schedule.h"

#include <cmath>

namespace hpmc {
namespace {

std::int64_t periods(double seconds) {
    return static_cast<std::int64_t>(std::llround(seconds / kSyncPeriod_s));
}

/// SplitMix64 (Steele, Lea, Flood 2014): decorrelates neighbouring seeds.
std::uint64_t mix(std::uint64_t value) {
    value += 0x9E3779B97F4A7C15U;
    value = (value ^ (value >> 30U)) * 0xBF58476D1CE4E5B9U;
    value = (value ^ (value >> 27U)) * 0x94D049BB133111EBU;
    return value ^ (value >> 31U);
}

} // namespace

Eigen::Vector3d home_pose_rad(const RunConfig &config) {
    constexpr int kStepsToSettle = 2000;
    const Eigen::Vector2d &home_m = config.experiment.centre_m;
    const PlanarArm arm(config.hpmc.arm);
    Eigen::Vector3d q_rad = arm.inverse(home_m, config.hpmc.dynamic_task.w_t_rad).q_rad;
    DynamicTask task(config.hpmc.dynamic_task, config.hpmc.arm);
    task.reset(q_rad);
    for (int i = 0; i < kStepsToSettle; ++i) {
        q_rad = task.step(home_m, Eigen::Vector2d::Zero(), q_rad).q_d_rad;
    }
    return q_rad;
}

RunSchedule::RunSchedule(const RunConfig &config)
    : experiment_(config.experiment), setup_(periods(config.schedule.setup_s)),
      reach_(periods(config.experiment.period_s)), reaches_(config.experiment.reaches),
      waypoint_(config.experiment.path == TargetPath::clock
                    ? reach_
                    : periods(config.experiment.waypoint_s)),
      stop_(periods(config.schedule.stop_s)) {}

Eigen::Vector2d RunSchedule::target_m(int target) const {
    if (target == 0) {
        return experiment_.centre_m;
    }
    const double angle = 2.0 * M_PI * (target - 1) / kClockTargets;
    return experiment_.centre_m +
           experiment_.radius_m * Eigen::Vector2d(std::cos(angle), std::sin(angle));
}

/// The waypoint that the target stands at, so many periods after the eight began.
Eigen::Vector2d RunSchedule::on_eight_m(std::int64_t into_reach) const {
    const std::int64_t waypoint = into_reach / waypoint_;
    const double s_rad =
        2.0 * M_PI * static_cast<double>(waypoint * waypoint_) / static_cast<double>(reach_);
    return experiment_.centre_m +
           experiment_.radius_m * Eigen::Vector2d(std::sin(2.0 * s_rad) / 2.0, std::sin(s_rad));
}

SchedulePoint RunSchedule::at(std::int64_t period) const {
    SchedulePoint point{};
    point.repetition = period / periods_per_repetition();
    point.period = period % periods_per_repetition();
    const std::int64_t since_first = point.period - setup_;
    const bool reaching = since_first >= 0 && since_first < reaches_ * reach_;
    const bool clock = experiment_.path == TargetPath::clock;
    const std::int64_t into_reach = reaching ? since_first % reach_ : 0;
    point.reach = reaching ? static_cast<int>(since_first / reach_) : -1;
    point.target = reaching && clock ? point.reach / 2 + 1 : 0;
    point.reach_begins = reaching && into_reach == 0;
    point.target_changes = reaching && into_reach % waypoint_ == 0;
    const std::int64_t targets_per_reach = (reach_ + waypoint_ - 1) / waypoint_;
    point.target_seq =
        (point.repetition * reaches_ + point.reach) * targets_per_reach + into_reach / waypoint_;
    point.stopping = since_first >= reaches_ * reach_;
    if (reaching && !clock) {
        point.x_t_m = on_eight_m(into_reach);
    } else {
        point.x_t_m = target_m(reaching && point.reach % 2 == 0 ? point.target : 0);
    }
    return point;
}

Eigen::Vector3d start_pose_rad(const RunConfig &config, std::int64_t repetition) {
    Eigen::Vector3d q_rad = home_pose_rad(config);
    const double increment_rad =
        2.0 * M_PI / static_cast<double>(config.joint.increments_per_revolution);
    std::uint64_t state = mix(static_cast<std::uint64_t>(config.experiment.seed)) ^
                          mix(static_cast<std::uint64_t>(repetition) + 0x5EED0000U);
    for (int joint = 0; joint < 3; ++joint) {
        state = mix(state);
        const double uniform = static_cast<double>(state >> 11U) * 0x1p-53; // 0..1
        q_rad[joint] += (2.0 * uniform - 1.0) * increment_rad;
    }
    return q_rad;
}

} // namespace hpmc
