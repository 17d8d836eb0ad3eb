#include <doctest/doctest.h>

#include <algorithm>

#include "closed_loop.h"

namespace {

struct Means {
    double planned_r = 0.0;
    double executed_r = 0.0;
    double position_rmse_m = 0.0;
    double velocity_rmse_m_s = 0.0;
    double position_rmse_worst_m = 0.0;
};

/// Means over 4 x 16 reaches that begin beside each other.
Means clock_means(hpmc::PhaseRule rule) {
    Means means;
    int count = 0;
    for (const double offset : {-1.0, 0.0, 1.0, 2.0}) {
        for (const test::ReachFigures &reach :
             test::run_clock(rule, {offset, 0.0, -offset}).reaches) {
            means.planned_r += reach.planned_r;
            means.executed_r += reach.executed_r;
            means.position_rmse_m += reach.position_rmse_m;
            means.velocity_rmse_m_s += reach.velocity_rmse_m_s;
            means.position_rmse_worst_m =
                std::max(means.position_rmse_worst_m, reach.position_rmse_m);
            ++count;
        }
    }
    means.planned_r /= count;
    means.executed_r /= count;
    means.position_rmse_m /= count;
    means.velocity_rmse_m_s /= count;
    MESSAGE("planned r " << means.planned_r << ", executed r " << means.executed_r
                         << ", position RMSE " << 1e3 * means.position_rmse_m
                         << " mm, velocity RMSE " << 1e3 * means.velocity_rmse_m_s << " mm/s");
    return means;
}

} // namespace

TEST_CASE("the clock without a bus, body_motion: the paper's figures") {
    const Means means = clock_means(hpmc::PhaseRule::body_motion);
    CHECK(means.planned_r == doctest::Approx(1.616).epsilon(2e-4));
    CHECK(means.executed_r > 1.78);
    CHECK(means.executed_r < 1.92);
    CHECK(means.position_rmse_m < 0.8e-3);
    CHECK(means.position_rmse_worst_m < 1.2e-3);
    CHECK(means.velocity_rmse_m_s > 0.012);
    CHECK(means.velocity_rmse_m_s < 0.020);
}

TEST_CASE("the clock without a bus, error_growth: smoother") {
    const Means means = clock_means(hpmc::PhaseRule::error_growth);
    CHECK(means.executed_r > 1.60);
    CHECK(means.executed_r < 1.68);
    CHECK(means.velocity_rmse_m_s < 0.009);
}
