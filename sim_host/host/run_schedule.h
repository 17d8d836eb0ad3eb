/**
 * Where a run stands at a SYNC period: repetition, reach, target. All parts of the rig derive it
 * from the configuration alone, so nobody has to tell anybody.
 *
 * A repetition takes a fixed number of periods: setup, the reaches, stop. On the clock a reach is
 * home to target or back, targets counter-clockwise from +x. On the figure of eight a reach is once
 * around the Lissajous figure (x: sin 2s / 2, y: sin s, times the radius) through home; its target
 * moves on by waypoints, since the elastic band makes a movement toward each target that it is
 * given. Run time of a period is its number times 1 ms, counted from repetition 0 whichever process
 * runs it.
 */
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "host/run_config.h"

namespace hpmc {

constexpr double kSyncPeriod_s = 0.001;
constexpr std::int64_t kSyncPeriod_us = 1000;

/// 2F01h. Stepped: a SYNC period is 1 ms of node time, however long it lasts. Free-running: it is
/// as long on the nodes' clocks as on the wall.
enum class TimeBase { stepped, free_running };

/// A SYNC period in node time.
inline std::int64_t sync_period_us(const RunConfig &config, TimeBase time_base) {
    return time_base == TimeBase::stepped ? kSyncPeriod_us : 1000000 / config.bench.sync_Hz;
}

struct SchedulePoint {
    std::int64_t repetition; ///< from 0
    std::int64_t period;     ///< within the repetition, from 0
    int reach;               ///< from 0, -1 outside the reaches
    int target;              ///< 1..8 the clock position the reach belongs to, 0 for none
    bool reach_begins;       ///< with this period
    bool target_changes;     ///< with this period
    std::int64_t target_seq; ///< of the target, counted from the begin of repetition 0
    bool stopping;           ///< the stop phase
    Eigen::Vector2d x_t_m;   ///< target of the hand
};

class RunSchedule {
  public:
    explicit RunSchedule(const RunConfig &config);

    std::int64_t periods_per_repetition() const { return setup_ + reaches_ * reach_ + stop_; }
    std::int64_t setup_periods() const { return setup_; }
    std::int64_t reach_periods() const { return reach_; }

    /// `period` counts from the begin of repetition 0.
    SchedulePoint at(std::int64_t period) const;

    Eigen::Vector2d target_m(int target) const; ///< 0 home, 1..8 clock

  private:
    Eigen::Vector2d on_eight_m(std::int64_t into_reach) const;

    ExperimentConfig experiment_;
    std::int64_t setup_;
    std::int64_t reach_;
    std::int64_t reaches_;
    std::int64_t waypoint_; ///< periods from one target to the next
    std::int64_t stop_;
};

/// The posture that the dynamic task comes to with the hand at rest at home.
Eigen::Vector3d home_pose_rad(const RunConfig &config);

/// Pose that a repetition starts from: home, each joint offset by a uniform number of encoder
/// increments between -1 and +1, drawn from (seed, repetition).
Eigen::Vector3d start_pose_rad(const RunConfig &config, std::int64_t repetition);

} // namespace hpmc
