#include <doctest/doctest.h>

#include <cstdlib>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

#include "allocation_counter.h"
#include "apps/sil_rig.h"
#include "node_bench.h"

using namespace hpmc;

namespace {

/// A file of this process's own.
std::string test_file(const std::string &name) {
    const char *folder = std::getenv("TMPDIR");
    return std::string(folder != nullptr ? folder : "/tmp") + "/hpmc-" + std::to_string(getpid()) +
           "-" + name;
}

const std::vector<std::string> kShort{"experiment.period_s=0.2", "experiment.repetitions=2"};

} // namespace

TEST_CASE("the loop allocates nothing") {
    SilRig rig({}, test::clock_config(kShort));
    std::int64_t period = rig.first_period();
    // Not the first period, in which a repetition begins.
    REQUIRE(rig.step(period++));
    const long before = test::allocations();
    while (period < rig.last_period() / 2) {
        REQUIRE(rig.step(period++));
    }
    CHECK(test::allocations() == before);
    CHECK(rig.fault().empty());
}

TEST_CASE("a part of the repetitions has the periods of just that part") {
    const RunConfig config = test::clock_config(kShort);
    SilOptions part;
    part.first_repetition = 1;
    part.repetitions = 1;
    const SilRig second(part, config);
    const SilRig all({}, config);
    const std::int64_t one = 1000 + 16 * 200 + 250;
    CHECK(second.first_period() == one);
    CHECK(second.last_period() == 2 * one);
    CHECK(all.first_period() == 0);
    CHECK(all.last_period() == 2 * one);
}

TEST_CASE("a stop on request ends within the quick stop's time, without a fault") {
    SilRig rig({}, test::clock_config());
    std::int64_t period = 0;
    while (period < 1500) {
        REQUIRE(rig.step(period++));
    }
    rig.request_stop();
    while (rig.step(period) && period < 2000) {
        ++period;
    }
    CHECK(period < 1700);
    CHECK(rig.fault().empty());
}

TEST_CASE("a log that cannot be made is said so") {
    SilOptions options;
    options.log = "/no/such/folder/run.lcmlog";
    CHECK_THROWS_AS(SilRig(options, test::clock_config()), LinkError);
}

TEST_CASE("no frame is lost, and the load is that of the bus budget") {
    SilRig rig({}, test::clock_config(kShort));
    for (std::int64_t p = 0; p < rig.last_period(); ++p) {
        REQUIRE(rig.step(p));
    }
    CHECK(rig.frames_lost() == 0);
    CHECK(rig.account().load_typical_percent() > 70.0);
    CHECK(rig.account().load_typical_percent() < bus_load_worst_percent(Sensors::direct));
    CHECK(bus_load_worst_percent(Sensors::direct) == doctest::Approx(87.5));
    CHECK(bus_load_worst_percent(Sensors::injected) == doctest::Approx(128.0));
}

namespace {

const std::vector<std::string> kLongReaches{"experiment.period_s=3"};

/// A log with targets from outside, as a run leaves them.
std::string targets_log(const std::vector<std::pair<std::int64_t, Eigen::Vector2d>> &targets) {
    const std::string path = test_file("targets.lcmlog");
    LcmLogWriter log(path);
    std::int64_t seq = 0;
    for (const auto &[utime, x_m] : targets) {
        hpmc_lcm::arm_target_t message{};
        message.utime = utime;
        message.seq = seq++;
        message.x_t_m[0] = x_m.x();
        message.x_t_m[1] = x_m.y();
        message.target = kOutsideTarget;
        log.publish("ARM_TARGET", message);
    }
    return path;
}

/// Messages of a channel, one after the other.
std::string bytes_of(const std::string &path, const std::string &channel) {
    std::string bytes;
    lcm_eventlog_t *log = lcm_eventlog_create(path.c_str(), "r");
    REQUIRE(log != nullptr);
    while (lcm_eventlog_event_t *event = lcm_eventlog_read_next_event(log)) {
        if (channel == std::string(event->channel, static_cast<std::size_t>(event->channellen))) {
            bytes.append(static_cast<const char *>(event->data),
                         static_cast<std::size_t>(event->datalen));
        }
        lcm_eventlog_free_event(event);
    }
    lcm_eventlog_destroy(log);
    return bytes;
}

/// Runs up to a period; where the hand is then.
Eigen::Vector2d run_until(const SilOptions &options, std::int64_t end,
                          const std::vector<std::string> &overrides = {}) {
    SilRig rig(options, test::clock_config(overrides));
    std::int64_t period = 0;
    while (period < end) {
        REQUIRE(rig.step(period++));
    }
    CHECK(rig.fault().empty());
    const hpmc_lcm::hpmc_state_t &state = rig.host().state();
    return {state.x_link_m[2][0], state.x_link_m[2][1]};
}

} // namespace

TEST_CASE("the hand goes where a target from outside says, and the log alone repeats that run") {
    SilOptions first;
    first.log = test_file("first.lcmlog");
    first.targets = targets_log({{2000000, {0.32, 0.05}}, {2100000, {0.27, -0.02}}});
    const Eigen::Vector2d hand_m = run_until(first, 3900, kLongReaches);
    CHECK((hand_m - Eigen::Vector2d(0.27, -0.02)).norm() < 0.002);

    SilOptions again = first;
    again.log = test_file("again.lcmlog");
    again.targets = first.log;
    run_until(again, 3900, kLongReaches);
    CHECK(bytes_of(first.log, "ARM_STATE") == bytes_of(again.log, "ARM_STATE"));
    CHECK(bytes_of(first.log, "ARM_TARGET") == bytes_of(again.log, "ARM_TARGET"));

    SilOptions plain;
    plain.log = test_file("plain.lcmlog");
    run_until(plain, 3900, kLongReaches);
    CHECK(bytes_of(first.log, "ARM_STATE") != bytes_of(plain.log, "ARM_STATE"));
}

TEST_CASE(
    "targets are numbered without gaps, those from outside in between, also with log states") {
    for (const LogLevel level : {LogLevel::full, LogLevel::states}) {
        SilOptions options;
        options.level = level;
        options.log = test_file("numbers.lcmlog");
        options.targets = targets_log({{1500000, {0.32, 0.05}}, {2000000, {0.27, -0.02}}});
        run_until(options, 3100);
        std::vector<std::int64_t> numbers;
        const std::string bytes = bytes_of(options.log, "ARM_TARGET");
        hpmc_lcm::arm_target_t message{};
        const int size = message.getEncodedSize();
        for (std::size_t at = 0; at < bytes.size(); at += static_cast<std::size_t>(size)) {
            REQUIRE(message.decode(bytes.data() + at, 0, size) == size);
            numbers.push_back(message.seq);
        }
        CHECK(numbers == (level == LogLevel::full ? std::vector<std::int64_t>{0, 1, 2, 3, 4}
                                                  : std::vector<std::int64_t>{1, 3}));
    }
}

TEST_CASE("a log without targets from outside is said so") {
    SilOptions options;
    options.targets = targets_log({});
    CHECK_THROWS_WITH(SilRig(options, test::clock_config()),
                      doctest::Contains("holds no target from outside the schedule"));
}
