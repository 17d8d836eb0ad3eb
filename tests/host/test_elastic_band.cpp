#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "hpmc/elastic_band.h"
#include "random_values.h"

using namespace hpmc;

namespace {

const Eigen::Vector2d home{0.3, 0.0};
const PhaseRule both_rules[] = {PhaseRule::body_motion, PhaseRule::error_growth};

ElasticBand band_at_rest(const Eigen::Vector2d &x_m, PhaseRule rule) {
    ElasticBandConfig config;
    config.phase_rule = rule;
    ElasticBand band{config};
    band.reset(x_m);
    return band;
}

} // namespace

TEST_CASE("from rest: a half cosine to 1e-4 m, T = 0.972 s, at rest at the target and staying") {
    const double duration_s = M_PI * std::sqrt(0.1 / (2.0 * 0.5223));
    CHECK(duration_s == doctest::Approx(0.972).epsilon(5e-4));
    for (const PhaseRule rule : both_rules) {
        for (int i = 0; i < 8; ++i) {
            const double angle = i * M_PI / 4.0;
            const Eigen::Vector2d way = 0.1 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
            ElasticBand band = band_at_rest(home, rule);
            for (int tick = 1; tick <= 5000; ++tick) {
                band.step(home + way);
                const double t_s = std::min(tick * 1e-3, duration_s);
                const double travelled = 0.5 * (1.0 - std::cos(M_PI * t_s / duration_s));
                REQUIRE((band.x_d_m() - home - travelled * way).norm() < 1e-4);
                if (tick >= 973) {
                    REQUIRE((band.x_d_m() - home - way).norm() < 1e-6);
                    REQUIRE(band.v_d_m_s().norm() < 5e-4);
                }
            }
        }
    }
}

TEST_CASE("arrival after 0.972 s: the distance falls until then and no longer") {
    ElasticBand band = band_at_rest(home, PhaseRule::body_motion);
    const Eigen::Vector2d target(0.4, 0.0);
    double distance_m = 0.1;
    int tick = 0;
    for (; tick < 2000; ++tick) {
        band.step(target);
        const double now_m = (target - band.x_d_m()).norm();
        if (now_m >= distance_m) {
            break;
        }
        distance_m = now_m;
    }
    CHECK(tick >= 971);
    CHECK(tick <= 973);
}

TEST_CASE("peak over mean speed in the 1 s window is 1.616") {
    for (const PhaseRule rule : both_rules) {
        ElasticBand band = band_at_rest(home, rule);
        double peak = 0.0;
        double sum = 0.0;
        for (int tick = 0; tick < 1000; ++tick) {
            band.step(home + Eigen::Vector2d(0.0, 0.1));
            peak = std::max(peak, band.v_d_m_s().norm());
            sum += band.v_d_m_s().norm();
        }
        CHECK(peak / (sum / 1000.0) == doctest::Approx(1.616).epsilon(2e-4));
    }
}

TEST_CASE("other distances take pi sqrt(D / 2A) as well") {
    for (const double distance_m : {0.02, 0.05, 0.2, 0.4}) {
        ElasticBand band = band_at_rest({0.0, 0.0}, PhaseRule::body_motion);
        const double duration_s = M_PI * std::sqrt(distance_m / (2.0 * 0.5223));
        const int ticks = static_cast<int>(std::lround(duration_s / 2e-3));
        for (int tick = 0; tick < ticks; ++tick) {
            band.step({distance_m, 0.0});
        }
        CHECK(band.x_d_m().x() == doctest::Approx(distance_m / 2.0).epsilon(0.01));
        for (int tick = 0; tick < ticks + 1; ++tick) {
            band.step({distance_m, 0.0});
        }
        CHECK(band.x_d_m().x() == doctest::Approx(distance_m).epsilon(1e-3));
    }
}

TEST_CASE("targets that change under way: never beyond A per axis, arrives and stays") {
    test::Random random(9);
    for (const PhaseRule rule : both_rules) {
        for (int run = 0; run < 40; ++run) {
            ElasticBand band = band_at_rest(home, rule);
            Eigen::Vector2d target = home;
            Eigen::Vector2d v_before = band.v_d_m_s();
            for (int tick = 0; tick < 12000; ++tick) {
                if (tick < 3000 && tick % 370 == 0) {
                    target = home + random.on_ring(0.0, 0.15);
                }
                band.step(target);
                const double acceleration_m_s2 = (band.v_d_m_s() - v_before).norm() / 1e-3;
                REQUIRE(acceleration_m_s2 <= std::sqrt(2.0) * 0.5223 * (1.0 + 1e-9));
                v_before = band.v_d_m_s();
                if (tick >= 10000) {
                    REQUIRE((band.x_d_m() - target).norm() < 1e-5);
                }
            }
        }
    }
}

TEST_CASE("a new target begins a new pull: full A toward it in the first step") {
    for (const PhaseRule rule : both_rules) {
        for (const double new_target_m : {-0.2, 0.06, 0.3}) {
            ElasticBand band = band_at_rest({0.0, 0.0}, rule);
            for (int tick = 0; tick < 486; ++tick) { // halfway, at the highest speed
                band.step({0.1, 0.0});
            }
            const double v_before = band.v_d_m_s().x();
            band.step({new_target_m, 0.0});
            const double toward = new_target_m > band.x_d_m().x() ? 1.0 : -1.0;
            CHECK((band.v_d_m_s().x() - v_before) / 1e-3 == doctest::Approx(toward * 0.5223));
        }
    }
}

TEST_CASE("the same path wherever the frame lies") {
    ElasticBand along_x = band_at_rest({0.0, 0.0}, PhaseRule::body_motion);
    ElasticBand turned = band_at_rest({0.0, 0.0}, PhaseRule::body_motion);
    const double angle = 0.7;
    const Eigen::Vector2d u(std::cos(angle), std::sin(angle));
    const Eigen::Vector2d n(-u.y(), u.x());
    for (int tick = 0; tick < 900; ++tick) {
        const Eigen::Vector2d target =
            tick < 400 ? Eigen::Vector2d(0.1, 0.0) : Eigen::Vector2d(0.02, 0.09);
        along_x.step(target);
        turned.step(target.x() * u + target.y() * n);
        const Eigen::Vector2d x = along_x.x_d_m();
        REQUIRE((turned.x_d_m() - x.x() * u - x.y() * n).norm() < 1e-9);
    }
}

TEST_CASE("without way to go nothing moves; NaN goes through until reset") {
    ElasticBand band = band_at_rest(home, PhaseRule::body_motion);
    band.step(home);
    CHECK(band.x_d_m() == home);
    band.step({std::numeric_limits<double>::quiet_NaN(), 0.0});
    CHECK_FALSE(band.x_d_m().allFinite());
    band.reset(home);
    band.step(home);
    CHECK(band.x_d_m() == home);
}

TEST_CASE("nonsense parameters are refused") {
    ElasticBandConfig config;
    config.acceleration_max_m_s2 = 0.0;
    CHECK_THROWS_AS(ElasticBand{config}, std::invalid_argument);
    config = {};
    config.saturation_m = -0.005;
    CHECK_THROWS_AS(ElasticBand{config}, std::invalid_argument);
    config = {};
    config.period_s = std::numeric_limits<double>::infinity();
    CHECK_THROWS_AS(ElasticBand{config}, std::invalid_argument);
}
