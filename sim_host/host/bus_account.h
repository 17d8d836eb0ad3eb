/**
 * Frames and load of the bus over a run: the share of a physical 1 Mbit/s bus that the traffic
 * would take, worst case from the cyclic frames, typical from bits counted exactly in a sample of
 * periods.
 */
#pragma once

#include <cstdint>

#include "host/host_cycle.h"
#include "link/bus_closing.h"

namespace hpmc {

class BusAccount {
  public:
    void add(std::int64_t period, const PeriodFrames &from_nodes, const HostCycleOutput &from_host);

    std::int64_t frames() const { return frames_; }
    /// Load while cyclic frames flow; 0 before any.
    double load_typical_percent() const;

  private:
    static constexpr std::int64_t kSamplePeriods = 97; ///< one period in so many is counted

    std::int64_t frames_ = 0;
    std::int64_t sampled_periods_ = 0;
    std::int64_t sampled_bits_ = 0;
};

/// Cyclic frames of a period with every one stuffed at its worst, in percent of 1 Mbit/s.
double bus_load_worst_percent(Sensors sensors);

} // namespace hpmc
