/**
 * Lines for whoever started the process, on standard output: READY, PROGRESS {json}, STATS {json}.
 */
#pragma once

#include <cstdint>
#include <cstdio>

#include "host/run_schedule.h"

namespace hpmc {

inline void say_ready() {
    std::puts("READY");
    std::fflush(stdout);
}

/// At most one line per 100 SYNC periods.
inline void say_progress(std::int64_t period, const SchedulePoint &point) {
    constexpr std::int64_t kPeriodsPerLine = 100;
    if (period % kPeriodsPerLine == 0) {
        std::printf("PROGRESS {\"repetition\": %lld, \"reach\": %d, \"simulated_s\": %.1f}\n",
                    static_cast<long long>(point.repetition), point.reach,
                    static_cast<double>(period) * kSyncPeriod_s);
        std::fflush(stdout);
    }
}

} // namespace hpmc
