#include <doctest/doctest.h>

#include <vector>

#include "allocation_counter.h"
#include "apps/sil_rig.h"
#include "node_bench.h"

using namespace hpmc;

namespace {

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
