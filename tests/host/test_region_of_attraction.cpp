#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "hpmc/region_of_attraction.h"
#include "random_values.h"

using namespace hpmc;

namespace {

constexpr double x_b = 0.020;
const Eigen::Vector3d stiffness_N_m{11000.0, 25000.0, 14000.0};

} // namespace

TEST_CASE("linear up to the knee, F_max beyond saturation") {
    const RegionOfAttraction region{RegionOfAttractionConfig{}};
    for (const Link link : {elbow, wrist, hand}) {
        const double k_0 = stiffness_N_m[static_cast<Eigen::Index>(link)];
        CHECK(region.force_N(link, 0.0) == 0.0);
        CHECK(region.force_N(link, 0.01) == doctest::Approx(k_0 * 0.01));
        CHECK(region.force_N(link, 0.95 * x_b) == doctest::Approx(0.95 * k_0 * x_b));
        CHECK(region.force_N(link, 2.0 * x_b) == doctest::Approx(k_0 * x_b));
        CHECK(region.force_N(link, 1.0) == doctest::Approx(k_0 * x_b));
    }
    CHECK(region.force_N(hand, 1.0) == doctest::Approx(280.0));
}

TEST_CASE("continuous at the knee to tanh(-pi), never falling, never above F_max") {
    RegionOfAttractionConfig config;
    for (const double f_max_factor : {1.0, 1.5}) {
        config.force_max_N = f_max_factor * x_b * stiffness_N_m;
        const RegionOfAttraction region{config};
        for (const Link link : {elbow, wrist, hand}) {
            const double f_b = stiffness_N_m[static_cast<Eigen::Index>(link)] * x_b;
            const double delta_f = (f_max_factor - 0.95) * f_b;
            const double before = region.force_N(link, 0.95 * x_b);
            const double after = region.force_N(link, 0.95 * x_b * (1.0 + 1e-12));
            CHECK(after - before ==
                  doctest::Approx(delta_f / 2.0 * (1.0 - std::tanh(M_PI))).epsilon(1e-3));
            double last = 0.0;
            for (int i = 0; i <= 4000; ++i) {
                const double force = region.force_N(link, i * 1e-5);
                REQUIRE(force >= last);
                REQUIRE(force <= f_max_factor * f_b * (1.0 + 1e-12));
                last = force;
            }
        }
    }
}

TEST_CASE("the wrench points from the actual to the desired position") {
    const RegionOfAttraction region{RegionOfAttractionConfig{}};
    test::Random random(6);
    for (int n = 0; n < 1000; ++n) {
        LinkEnds desired;
        LinkEnds actual;
        for (const Link link : {elbow, wrist, hand}) {
            desired[link] = random.on_ring(0.0, 0.6);
            actual[link] = desired[link] + random.on_ring(0.0, 0.04);
        }
        const auto wrench = region.step(desired, actual);
        for (const Link link : {elbow, wrist, hand}) {
            const Eigen::Vector2d error = desired[link] - actual[link];
            REQUIRE(wrench[link].norm() ==
                    doctest::Approx(region.force_N(link, error.norm())).epsilon(1e-9));
            REQUIRE(wrench[link].dot(error) ==
                    doctest::Approx(wrench[link].norm() * error.norm()).epsilon(1e-9));
        }
    }
}

TEST_CASE("no error, no wrench; NaN goes through") {
    const RegionOfAttraction region{RegionOfAttractionConfig{}};
    LinkEnds ends;
    ends.fill(Eigen::Vector2d(0.1, 0.2));
    CHECK(region.step(ends, ends)[hand] == Eigen::Vector2d(0.0, 0.0));
    LinkEnds lost = ends;
    lost[hand].x() = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(region.step(ends, lost)[hand].allFinite());
}

TEST_CASE("F_max below K0 x_b and other nonsense is refused") {
    RegionOfAttractionConfig config;
    config.force_max_N[2] = 279.0;
    CHECK_THROWS_AS(RegionOfAttraction{config}, std::invalid_argument);
    config = {};
    config.saturation_m = 0.0;
    CHECK_THROWS_AS(RegionOfAttraction{config}, std::invalid_argument);
    config = {};
    config.stiffness_N_m[0] = -1.0;
    CHECK_THROWS_AS(RegionOfAttraction{config}, std::invalid_argument);
}
