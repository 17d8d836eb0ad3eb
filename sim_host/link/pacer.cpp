#include "link/pacer.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "port/posix/stop_signal.h"

namespace hpmc {
namespace {

constexpr std::int64_t kLateParts = 10; ///< a cycle is late by a period over this

std::int64_t monotonic_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

void sleep_until(std::int64_t due_ns) {
    const timespec due{due_ns / 1000000000, due_ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr) == EINTR &&
           !stop_signal_raised()) {
    }
}

} // namespace

void Pacer::wait() {
    const std::int64_t now_ns = monotonic_ns();
    if (cycles_ == 0) {
        due_ns_ = now_ns;
    } else {
        due_ns_ += period_ns_;
        overruns_ += now_ns > due_ns_ ? 1 : 0;
    }
    sleep_until(due_ns_);
    count(monotonic_ns());
}

void Pacer::count(std::int64_t now_ns) {
    const std::int64_t lateness_ns = std::max<std::int64_t>(now_ns - due_ns_, 0);
    lateness_max_ns_ = std::max(lateness_max_ns_, lateness_ns);
    late_ += lateness_ns > period_ns_ / kLateParts ? 1 : 0;
    ++lateness_[bin_of(lateness_ns)];
    if (cycles_ > 0) {
        const std::int64_t interval_ns = now_ns - begin_ns_;
        ++intervals_[bin_of(interval_ns)];
        const double off_us = static_cast<double>(interval_ns - period_ns_) * 1e-3;
        jitter_square_us2_ += off_us * off_us;
    }
    begin_ns_ = now_ns;
    if (when_late_ == WhenLate::start_anew && 2 * lateness_ns >= period_ns_) {
        due_ns_ = now_ns;
    }
    ++cycles_;
}

std::size_t Pacer::bin_of(std::int64_t time_ns) const {
    const auto bin = static_cast<std::size_t>(time_ns * kBinsPerPeriod / period_ns_);
    return std::min(bin, intervals_.size() - 1);
}

double Pacer::bin_us() const {
    return static_cast<double>(period_ns_) * 1e-3 / kBinsPerPeriod;
}

/// Upper edge of the bin in which the fraction is reached.
double Pacer::lateness_us_below(double fraction) const {
    std::int64_t counted = 0;
    for (std::size_t bin = 0; bin < lateness_.size(); ++bin) {
        counted += lateness_[bin];
        if (static_cast<double>(counted) >= fraction * static_cast<double>(cycles_)) {
            return static_cast<double>(bin + 1) * bin_us();
        }
    }
    return static_cast<double>(lateness_.size()) * bin_us();
}

std::string Pacer::stats_json() const {
    const double intervals = static_cast<double>(std::max<std::int64_t>(cycles_ - 1, 1));
    char text[400];
    std::snprintf(text, sizeof text,
                  "\"period_us\": %.3f, \"cycles\": %lld, \"overruns\": %lld, "
                  "\"late_cycles\": %lld, \"lateness_max_us\": %lld, \"lateness_p99_us\": %.1f, "
                  "\"jitter_us\": %.1f, \"histogram_bin_us\": %.3f, \"period_histogram\": [",
                  static_cast<double>(period_ns_) * 1e-3, static_cast<long long>(cycles_),
                  static_cast<long long>(overruns_), static_cast<long long>(late_),
                  static_cast<long long>(lateness_max_us()), lateness_us_below(0.99),
                  std::sqrt(jitter_square_us2_ / intervals), bin_us());
    std::string json = text;
    const char *separator = "";
    for (std::size_t bin = 0; bin < intervals_.size(); ++bin) {
        if (intervals_[bin] > 0) {
            std::snprintf(text, sizeof text, "%s[%zu, %lld]", separator, bin,
                          static_cast<long long>(intervals_[bin]));
            json += text;
            separator = ", ";
        }
    }
    return json + "]";
}

} // namespace hpmc
