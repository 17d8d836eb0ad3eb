/**
 * Holds a loop back to the wall clock, one SYNC period a call. A late loop catches up, so that run
 * time keeps to the wall clock on average. Results do not depend on it.
 */
#pragma once

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <ctime>

#include "host/run_schedule.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

namespace hpmc {

class Pacer {
  public:
    explicit Pacer(bool active) : active_(active) {}

    /// Returns when the next period is to begin; at once when it should have begun already, or when
    /// the process is asked to stop.
    void wait() {
        if (!active_) {
            return;
        }
        const std::int64_t now_ns = monotonic_ns();
        next_ns_ = next_ns_ == 0 ? now_ns : next_ns_ + kSyncPeriod_us * 1000;
        overruns_ += now_ns > next_ns_ ? 1 : 0;
        const timespec next{next_ns_ / 1000000000, next_ns_ % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, nullptr) == EINTR &&
               !stop_signal_raised()) {
        }
        lateness_max_us_ = std::max(lateness_max_us_, (monotonic_ns() - next_ns_) / 1000);
    }

    /// Periods that were not done when the next one should have begun.
    std::int64_t overruns() const { return overruns_; }
    /// How late a period began at worst.
    std::int64_t lateness_max_us() const { return lateness_max_us_; }

  private:
    static std::int64_t monotonic_ns() {
        timespec now{};
        clock_gettime(CLOCK_MONOTONIC, &now);
        return now.tv_sec * 1000000000LL + now.tv_nsec;
    }

    bool active_;
    std::int64_t next_ns_ = 0;
    std::int64_t overruns_ = 0;
    std::int64_t lateness_max_us_ = 0;
};

} // namespace hpmc
