#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "hpmc/dynamic_task.h"
#include "random_values.h"

using namespace hpmc;

namespace {

constexpr double degree = M_PI / 180.0;
const Eigen::Vector2d home{0.3, 0.0};
const Eigen::Vector2d at_rest{0.0, 0.0};
const PlanarArm arm{PlanarArmConfig{}};

DynamicTaskConfig with_posture(Posture posture) {
    DynamicTaskConfig config;
    config.posture = posture;
    return config;
}

DynamicTask task_at(const Eigen::Vector2d &x_m, double phi_rad, const DynamicTaskConfig &config) {
    DynamicTask task{config, PlanarArmConfig{}};
    task.reset(arm.inverse(x_m, phi_rad).q_rad);
    return task;
}

double cost_m2(const Eigen::Vector2d &x_m, double phi_rad, double w_t_rad) {
    return DynamicTask::interaction_cost_m2(arm, x_m, phi_rad, w_t_rad);
}

/// Steps with a perfect arm (measured = desired), checking what holds in every step.
DesiredPosture settle(DynamicTask &task, const Eigen::Vector2d &x_m, Eigen::Vector3d q_rad,
                      int steps) {
    DesiredPosture posture{};
    for (int i = 0; i < steps; ++i) {
        posture = task.step(x_m, at_rest, q_rad);
        REQUIRE(posture.q_d_rad.allFinite());
        REQUIRE((posture.q_d_rad - q_rad).cwiseAbs().maxCoeff() <= 0.004 + 1e-12);
        q_rad = posture.q_d_rad;
    }
    return posture;
}

} // namespace

TEST_CASE("paper posture: hand along W_t on X_d, no wrist torque from a force along W_t") {
    DynamicTask task = task_at(home, 155.0 * degree, with_posture(Posture::paper));
    const Eigen::Vector3d q = arm.inverse(home, 155.0 * degree).q_rad;
    const DesiredPosture posture = task.step(home, at_rest, q);
    CHECK_FALSE(posture.saturated);
    CHECK(posture.phi_rad == doctest::Approx(155.0 * degree));
    const LinkEnds ends = arm.link_ends(posture.q_d_rad);
    CHECK((ends[hand] - home).norm() < 1e-12);
    const Eigen::Vector2d w_t(std::cos(155.0 * degree), std::sin(155.0 * degree));
    CHECK(std::abs(PlanarArm::jacobian(ends, hand).col(2).dot(w_t)) < 1e-12);
    CHECK(posture.q_d_rad[1] > 0.0);
}

TEST_CASE("at home the closed form costs .0839 m^2, the minimiser .0686 m^2 at -117.5 deg") {
    CHECK(cost_m2(home, 155.0 * degree, 155.0 * degree) == doctest::Approx(0.0839).epsilon(1e-3));
    DynamicTask task = task_at(home, 155.0 * degree, with_posture(Posture::optimal));
    const DesiredPosture posture =
        settle(task, home, arm.inverse(home, 155.0 * degree).q_rad, 2000);
    const double phi_deg = std::remainder(posture.phi_rad, 2.0 * M_PI) / degree;
    CHECK(phi_deg == doctest::Approx(-117.5).epsilon(2e-3));
    CHECK(cost_m2(home, posture.phi_rad, 155.0 * degree) == doctest::Approx(0.0686).epsilon(1e-3));
    CHECK((arm.link_ends(posture.q_d_rad)[hand] - home).norm() < 1e-12);
}

TEST_CASE("optimal at rest: same end point, within 1 % of the best of a fine scan, never above the "
          "closed form") {
    test::Random random(11);
    for (int run = 0; run < 150; ++run) {
        const Eigen::Vector2d x = random.on_ring(0.10, 0.50);
        const double phi_0 = random.uniform(-M_PI, M_PI);
        DynamicTaskConfig config = with_posture(Posture::optimal);
        config.w_t_rad = random.uniform(-M_PI, M_PI);
        DynamicTask task = task_at(x, phi_0, config);
        const DesiredPosture posture = settle(task, x, arm.inverse(x, phi_0).q_rad, 3000);
        REQUIRE_FALSE(posture.saturated);
        REQUIRE((arm.link_ends(posture.q_d_rad)[hand] - x).norm() < 1e-12);
        const double cost = cost_m2(x, posture.phi_rad, config.w_t_rad);
        REQUIRE(cost <= cost_m2(x, config.w_t_rad, config.w_t_rad) * (1.0 + 1e-9));
        double least = cost;
        for (int i = 0; i < 720; ++i) {
            least = std::min(least, cost_m2(x, i * 0.5 * degree, config.w_t_rad));
        }
        REQUIRE(cost <= least / 0.98);
    }
}

TEST_CASE("optimal along the clock's reaches: no jumps, end point kept, minimum followed") {
    DynamicTask task = task_at(home, 155.0 * degree, with_posture(Posture::optimal));
    Eigen::Vector3d q = settle(task, home, arm.inverse(home, 155.0 * degree).q_rad, 2000).q_d_rad;
    for (int i = 0; i < 8; ++i) {
        const double angle = i * M_PI / 4.0;
        for (int tick = 0; tick <= 2000; ++tick) {
            const double travelled = 0.5 * (1.0 - std::cos(M_PI * tick / 1000.0));
            const Eigen::Vector2d x =
                home + 0.1 * travelled * Eigen::Vector2d(std::cos(angle), std::sin(angle));
            const DesiredPosture posture = task.step(x, at_rest, q);
            REQUIRE((posture.q_d_rad - q).cwiseAbs().maxCoeff() <= 0.004 + 1e-12);
            REQUIRE((arm.link_ends(posture.q_d_rad)[hand] - x).norm() < 1e-12);
            const double cost = cost_m2(x, posture.phi_rad, 155.0 * degree);
            REQUIRE(cost <= cost_m2(x, 155.0 * degree, 155.0 * degree));
            REQUIRE(cost <= 1.001 * cost_m2(x, posture.phi_rad + 0.01, 155.0 * degree));
            REQUIRE(cost <= 1.001 * cost_m2(x, posture.phi_rad - 0.01, 155.0 * degree));
            q = posture.q_d_rad;
        }
    }
}

TEST_CASE("optimal near the outer edge turns the hand within reach, where the closed form cannot") {
    const Eigen::Vector2d x(0.58, 0.0);
    DynamicTask task = task_at(x, 0.0, with_posture(Posture::optimal));
    const DesiredPosture posture = settle(task, x, arm.inverse(x, 0.0).q_rad, 2000);
    CHECK_FALSE(posture.saturated);
    CHECK((arm.link_ends(posture.q_d_rad)[hand] - x).norm() < 1e-9);
    CHECK(arm.inverse(x, 155.0 * degree).saturated);
}

TEST_CASE("optimal near the outer edge: the hand turns the way that stays within reach") {
    // At .52 m the hand may point within 133 deg of the bearing; the short way across the back may
    // not.
    const Eigen::Vector2d x(0.52, 0.0);
    bool went_the_long_way = false;
    for (int w_t_deg = 0; w_t_deg < 180; w_t_deg += 10) {
        DynamicTaskConfig config = with_posture(Posture::optimal);
        config.w_t_rad = w_t_deg * degree;
        DynamicTask task = task_at(x, 130.0 * degree, config);
        Eigen::Vector3d q = arm.inverse(x, 130.0 * degree).q_rad;
        for (int i = 0; i < 3000; ++i) {
            q = task.step(x, at_rest, q).q_d_rad;
            REQUIRE((arm.link_ends(q)[hand] - x).norm() < 1e-9);
        }
        went_the_long_way = went_the_long_way || q.sum() < -50.0 * degree;
    }
    CHECK(went_the_long_way);
}

TEST_CASE("each angle is the one nearest to the measured, whatever turn that is on") {
    const Eigen::Vector3d q = arm.inverse(home, 155.0 * degree).q_rad;
    for (const double turns : {-2.0, -1.0, 1.0, 3.0}) {
        const Eigen::Vector3d wound = q + 2.0 * M_PI * turns * Eigen::Vector3d(1.0, -1.0, 1.0);
        DynamicTask task{DynamicTaskConfig{}, PlanarArmConfig{}};
        task.reset(wound);
        const DesiredPosture posture = task.step(home, at_rest, wound);
        CHECK((posture.q_d_rad - wound).cwiseAbs().maxCoeff() < 1e-12);
    }
}

TEST_CASE("a new W_t by message turns the hand there at the bounded rate, end point kept") {
    for (const double w_t_deg : {60.0, -100.0, -25.5}) {
        DynamicTask task = task_at(home, 155.0 * degree, with_posture(Posture::paper));
        Eigen::Vector3d q = arm.inverse(home, 155.0 * degree).q_rad;
        task.set_direction(w_t_deg * degree);
        int ticks = 0;
        for (; ticks < 3000; ++ticks) {
            const DesiredPosture posture = task.step(home, at_rest, q);
            REQUIRE((posture.q_d_rad - q).cwiseAbs().maxCoeff() <= 0.004 + 1e-12);
            REQUIRE((arm.link_ends(posture.q_d_rad)[hand] - home).norm() < 1e-12);
            q = posture.q_d_rad;
            if (std::abs(std::remainder(posture.phi_rad - w_t_deg * degree, 2.0 * M_PI)) < 1e-9) {
                break;
            }
        }
        CHECK(ticks > 100);
        CHECK(ticks < 3000);
    }
}

TEST_CASE("direction modes: radial, and along the motion, kept at rest") {
    const Eigen::Vector2d x(0.25, 0.15);
    DynamicTaskConfig config;
    config.direction = TaskDirection::radial;
    const double bearing = std::atan2(0.15, 0.25);
    DynamicTask radial = task_at(x, bearing, config);
    CHECK(radial.step(x, at_rest, arm.inverse(x, bearing).q_rad).phi_rad ==
          doctest::Approx(bearing));

    config.direction = TaskDirection::motion;
    DynamicTask motion = task_at(x, 1.0, config);
    const Eigen::Vector2d velocity(0.1 * std::cos(1.0), 0.1 * std::sin(1.0));
    const Eigen::Vector3d q = arm.inverse(x, 1.0).q_rad;
    CHECK(motion.step(x, velocity, q).phi_rad == doctest::Approx(1.0));
    CHECK(motion.step(x, at_rest, q).phi_rad == doctest::Approx(1.0));
}

TEST_CASE("from an arbitrary measured posture, elbow on the wrong side too, blends to the task's") {
    test::Random random(12);
    for (const Posture kind : {Posture::paper, Posture::optimal}) {
        for (int run = 0; run < 100; ++run) {
            const Eigen::Vector3d q = random.vector3(-M_PI, M_PI);
            DynamicTask task{with_posture(kind), PlanarArmConfig{}};
            task.reset(q);
            const Eigen::Vector2d x = random.on_ring(0.10, 0.45);
            const DesiredPosture posture = settle(task, x, q, 4000);
            REQUIRE_FALSE(posture.saturated);
            REQUIRE((arm.link_ends(posture.q_d_rad)[hand] - x).norm() < 1e-9);
            if (kind == Posture::paper) {
                REQUIRE(std::abs(std::remainder(posture.phi_rad - 155.0 * degree, 2.0 * M_PI)) <
                        1e-9);
            }
        }
    }
}

TEST_CASE("X_d anywhere: finite, bounded step, and flagged when out of reach") {
    test::Random random(13);
    for (const Posture kind : {Posture::paper, Posture::optimal}) {
        DynamicTask task{with_posture(kind), PlanarArmConfig{}};
        Eigen::Vector3d q = arm.inverse(home, 155.0 * degree).q_rad;
        task.reset(q);
        int flagged = 0;
        for (int n = 0; n < 3000; ++n) {
            const bool far = n % 2 == 1;
            const Eigen::Vector2d x = far ? random.on_ring(0.596, 5.0) : random.on_ring(0.0, 0.6);
            const DesiredPosture posture = task.step(x, random.on_ring(0.0, 1.0), q);
            REQUIRE(posture.q_d_rad.allFinite());
            REQUIRE((posture.q_d_rad - q).cwiseAbs().maxCoeff() <= 0.004 + 1e-12);
            REQUIRE((!far || posture.saturated));
            flagged += posture.saturated;
            q = posture.q_d_rad;
        }
        CHECK(flagged < 2999);
        for (const double extreme : {0.0, 1e-300, 1e150}) {
            REQUIRE(task.step({extreme, -extreme}, at_rest, q).q_d_rad.allFinite());
        }
    }
}

TEST_CASE("NaN in, NaN out") {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const Posture kind : {Posture::paper, Posture::optimal}) {
        DynamicTask task = task_at(home, 155.0 * degree, with_posture(kind));
        const Eigen::Vector3d q = arm.inverse(home, 155.0 * degree).q_rad;
        CHECK_FALSE(task.step({nan, 0.0}, at_rest, q).q_d_rad.allFinite());
    }
}

TEST_CASE("nonsense parameters are refused") {
    DynamicTaskConfig config;
    config.joint_step_max_rad = 0.0;
    CHECK_THROWS_AS(DynamicTask(config, PlanarArmConfig{}), std::invalid_argument);
    config = {};
    config.w_t_rad = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(DynamicTask(config, PlanarArmConfig{}), std::invalid_argument);
    CHECK_THROWS_AS(DynamicTask(with_posture(Posture::optimal), PlanarArmConfig{{0.2, 0.1, 0.15}}),
                    std::invalid_argument);
}
