/**
 * Where a run stands at a SYNC period: repetition, reach, target. All parts of the rig derive it
 * from the configuration alone, so nobody has to tell anybody.
 *
 * A repetition takes a fixed number of periods: setup, 16 reaches (home to target and back, targets
 * counter-clockwise from +x), stop. Run time of a period is its number times 1 ms, counted from
 * repetition 0 whichever process runs it.
 */
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "host/run_config.h"

namespace hpmc {

constexpr double kSyncPeriod_s = 0.001;
constexpr std::int64_t kSyncPeriod_us = 1000;
constexpr int kReaches = 2 * kClockTargets;

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
    int reach;               ///< 0..15, -1 outside the reaches
    int target;              ///< 1..8 the clock position the reach belongs to, 0 outside
    bool target_changes;     ///< a reach begins with this period
    bool stopping;           ///< the stop phase
    Eigen::Vector2d x_t_m;   ///< target of the hand
};

class RunSchedule {
  public:
    explicit RunSchedule(const RunConfig &config);

    std::int64_t periods_per_repetition() const { return setup_ + kReaches * reach_ + stop_; }
    std::int64_t setup_periods() const { return setup_; }
    std::int64_t reach_periods() const { return reach_; }

    /// `period` counts from the begin of repetition 0.
    SchedulePoint at(std::int64_t period) const;

    Eigen::Vector2d target_m(int target) const; ///< 0 home, 1..8 clock

  private:
    ExperimentConfig experiment_;
    std::int64_t setup_;
    std::int64_t reach_;
    std::int64_t stop_;
};

/// The posture that the dynamic task comes to with the hand at rest at home.
Eigen::Vector3d home_pose_rad(const RunConfig &config);

/// Pose that a repetition starts from: home, each joint offset by a uniform number of encoder
/// increments between -1 and +1, drawn from (seed, repetition).
Eigen::Vector3d start_pose_rad(const RunConfig &config, std::int64_t repetition);

} // namespace hpmc
