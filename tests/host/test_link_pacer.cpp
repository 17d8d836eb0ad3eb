#include <doctest/doctest.h>

#include <chrono>
#include <string>

#include "link/pacer.h"

using namespace hpmc;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::int64_t kPeriod_ns = 2000000;

void spend(std::int64_t time_ns) {
    const auto until = Clock::now() + std::chrono::nanoseconds(time_ns);
    while (Clock::now() < until) {
    }
}

} // namespace

TEST_CASE("no cycle begins before its time") {
    Pacer pacer(kPeriod_ns, Pacer::WhenLate::catch_up);
    const auto before = Clock::now();
    for (int i = 0; i < 6; ++i) {
        pacer.wait();
    }
    CHECK(Clock::now() - before >= std::chrono::nanoseconds(5 * kPeriod_ns));
    CHECK(pacer.stats_json().find("\"cycles\": 6,") != std::string::npos);
}

TEST_CASE("a cycle that takes too long is an overrun, and the loop catches up") {
    Pacer pacer(kPeriod_ns, Pacer::WhenLate::catch_up);
    pacer.wait();
    spend(3 * kPeriod_ns + kPeriod_ns / 2);
    pacer.wait();
    CHECK(pacer.overruns() == 1);
    CHECK(pacer.lateness_max_us() >= 5 * kPeriod_ns / 2000);
    pacer.wait(); // was due before the cycle began
    pacer.wait();
    CHECK(pacer.overruns() >= 3);
}

TEST_CASE("when the grid starts anew a whole period follows a late cycle") {
    Pacer pacer(kPeriod_ns, Pacer::WhenLate::start_anew);
    pacer.wait();
    spend(3 * kPeriod_ns + kPeriod_ns / 2);
    const auto before = Clock::now();
    pacer.wait(); // begins at once, late
    pacer.wait();
    CHECK(Clock::now() - before >= std::chrono::nanoseconds(kPeriod_ns));
    CHECK(pacer.overruns() >= 1);
    CHECK(pacer.stats_json().find("\"late_cycles\": 0") == std::string::npos);
}
