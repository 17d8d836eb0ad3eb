/**
 * Cycles on the wall clock: waits for absolute times, and counts how well the loop kept to them.
 *
 * Names, here and in summary.json: a cycle is *late* when it begins more than a tenth of a period
 * after its time; an *overrun* is a time at which the cycle before was not done. Lateness is begin
 * minus due time, jitter the root mean square of interval minus period.
 */
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace hpmc {

class Pacer {
  public:
    /// What happens after a cycle that began late by half a period or more: the loop hurries until
    /// it is on time again; or the grid starts anew with that cycle, so that no SYNC follows
    /// another before the nodes had time to answer.
    enum class WhenLate { catch_up, start_anew };

    Pacer(std::int64_t period_ns, WhenLate when_late)
        : period_ns_(period_ns), when_late_(when_late) {}

    /// Returns at the next time of the grid, which begins with the first call; sooner after a stop
    /// signal.
    void wait();

    std::int64_t overruns() const { return overruns_; }
    std::int64_t lateness_max_us() const { return lateness_max_ns_ / 1000; }

    /// Everything measured, as the inside of a JSON object.
    std::string stats_json() const;

  private:
    static constexpr int kBinsPerPeriod = 200;
    static constexpr int kPeriodsCovered = 4;
    /// Counts of times in units of period / kBinsPerPeriod; the last bin takes what is longer.
    using Histogram = std::array<std::int64_t, kBinsPerPeriod * kPeriodsCovered>;

    std::size_t bin_of(std::int64_t time_ns) const;
    double bin_us() const;
    double lateness_us_below(double fraction) const;
    void count(std::int64_t now_ns);

    std::int64_t period_ns_;
    WhenLate when_late_;
    std::int64_t due_ns_ = 0;
    std::int64_t begin_ns_ = 0;
    std::int64_t cycles_ = 0;
    std::int64_t overruns_ = 0;
    std::int64_t late_ = 0;
    std::int64_t lateness_max_ns_ = 0;
    double jitter_square_us2_ = 0.0;
    Histogram lateness_{};
    Histogram intervals_{};
};

} // namespace hpmc
