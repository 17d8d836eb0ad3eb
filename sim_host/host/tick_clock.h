/**
 * Run time of joint ticks: number and microseconds of tick j (0..joint_ticks-1) of a SYNC period.
 */
#pragma once

#include <cstdint>

#include "host/run_schedule.h"

namespace hpmc {

struct TickClock {
    std::int64_t joint_ticks; ///< per SYNC period, 1..10

    std::int64_t seq(std::int64_t period, std::int64_t tick) const {
        return period * joint_ticks + tick;
    }
    std::int64_t utime(std::int64_t period, std::int64_t tick) const {
        return period * kSyncPeriod_us + tick * kSyncPeriod_us / joint_ticks;
    }
    double joint_period_s() const { return kSyncPeriod_s / static_cast<double>(joint_ticks); }
};

} // namespace hpmc
