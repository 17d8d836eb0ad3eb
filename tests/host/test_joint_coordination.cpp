#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "hpmc/joint_coordination.h"
#include "random_values.h"

using namespace hpmc;

namespace {

const PlanarArm arm{PlanarArmConfig{}};
const Eigen::Vector2d no_wrench{0.0, 0.0};

std::array<Eigen::Vector2d, 3> random_wrenches(test::Random &random, double most_N) {
    return {random.on_ring(0.0, most_N), random.on_ring(0.0, most_N), random.on_ring(0.0, most_N)};
}

} // namespace

TEST_CASE("desired torque does the work of 2 W_d - W, checked by virtual work") {
    test::Random random(7);
    JointCoordination coordination{JointCoordinationConfig{}};
    for (int n = 0; n < 500; ++n) {
        const Eigen::Vector3d q = random.vector3(-M_PI, M_PI);
        const auto w_link = random_wrenches(random, 100.0);
        const Eigen::Vector2d w = random.on_ring(0.0, 50.0);
        coordination.reset();
        JointTorques torques;
        for (int settle = 0; settle < 200; ++settle) {
            torques = coordination.step(w_link, arm.link_ends(q), w);
        }
        constexpr double h = 1e-6;
        for (Eigen::Index joint = 0; joint < 3; ++joint) {
            const Eigen::Vector3d dq = h * Eigen::Vector3d::Unit(joint);
            const Eigen::Vector2d dx =
                (arm.link_ends(q + dq)[hand] - arm.link_ends(q - dq)[hand]) / (2.0 * h);
            REQUIRE(std::abs(torques.tau_d_Nm[joint] - dx.dot(2.0 * w_link[hand] - w)) < 1e-6);
        }
    }
}

TEST_CASE("T_max takes row i from link i: elbow, wrist, twice the hand") {
    JointCoordination coordination{JointCoordinationConfig{}};
    const LinkEnds ends = arm.link_ends({0.0, 0.0, 0.0});
    const Eigen::Vector2d up(0.0, 1.0);
    const auto t_max = [&](Link link) {
        std::array<Eigen::Vector2d, 3> w_link{no_wrench, no_wrench, no_wrench};
        w_link[link] = 10.0 * up;
        return coordination.step(w_link, ends, no_wrench).tau_max_Nm;
    };
    CHECK(t_max(elbow).isApprox(Eigen::Vector3d(2.82, 0.0, 0.0)));
    CHECK(t_max(wrist).isApprox(Eigen::Vector3d(0.0, 2.69, 0.0)));
    CHECK(t_max(hand).isApprox(Eigen::Vector3d(0.0, 0.0, 0.88)));
}

TEST_CASE("T_max is never above TA and never negative") {
    test::Random random(8);
    JointCoordination coordination{JointCoordinationConfig{}};
    int limited = 0;
    for (int n = 0; n < 5000; ++n) {
        const LinkEnds ends = arm.link_ends(random.vector3(-M_PI, M_PI));
        const Eigen::Vector3d t_max =
            coordination.step(random_wrenches(random, 500.0), ends, random.on_ring(0.0, 500.0))
                .tau_max_Nm;
        REQUIRE(t_max.minCoeff() >= 0.0);
        REQUIRE(t_max[0] <= 30.0);
        REQUIRE(t_max[1] <= 20.0);
        REQUIRE(t_max[2] <= 5.0);
        limited += t_max == Eigen::Vector3d(30.0, 20.0, 5.0);
    }
    CHECK(limited > 100);
}

TEST_CASE("the measured wrench passes a first-order low-pass of the given cut-off") {
    for (const double cutoff_Hz : {20.0, 100.0, 200.0}) {
        JointCoordinationConfig config;
        config.wrench_cutoff_Hz = cutoff_Hz;
        JointCoordination coordination{config};
        const LinkEnds ends = arm.link_ends({0.0, 0.5, 0.5});
        const std::array<Eigen::Vector2d, 3> w_link{no_wrench, no_wrench, no_wrench};
        for (int tick = 1; tick <= 50; ++tick) {
            coordination.step(w_link, ends, {10.0, -4.0});
            const double risen = 1.0 - std::exp(-2.0 * M_PI * cutoff_Hz * tick * 1e-3);
            REQUIRE(coordination.filtered_wrench_N().x() == doctest::Approx(10.0 * risen));
            REQUIRE(coordination.filtered_wrench_N().y() == doctest::Approx(-4.0 * risen));
        }
        coordination.reset();
        CHECK(coordination.filtered_wrench_N() == no_wrench);
    }
}

TEST_CASE("NaN goes through to both torques") {
    JointCoordination coordination{JointCoordinationConfig{}};
    const double nan = std::numeric_limits<double>::quiet_NaN();
    std::array<Eigen::Vector2d, 3> w_link;
    w_link.fill(Eigen::Vector2d(nan, nan));
    const JointTorques torques =
        coordination.step(w_link, arm.link_ends({0.0, 0.5, 0.5}), no_wrench);
    CHECK(torques.tau_d_Nm.array().isNaN().all());
    CHECK(torques.tau_max_Nm.array().isNaN().all());
}

TEST_CASE("a cut-off outside 20..200 Hz and other nonsense is refused") {
    JointCoordinationConfig config;
    config.wrench_cutoff_Hz = 19.9;
    CHECK_THROWS_AS(JointCoordination{config}, std::invalid_argument);
    config.wrench_cutoff_Hz = 200.1;
    CHECK_THROWS_AS(JointCoordination{config}, std::invalid_argument);
    config = {};
    config.torque_limit_Nm[1] = 0.0;
    CHECK_THROWS_AS(JointCoordination{config}, std::invalid_argument);
    config = {};
    config.period_s = 0.0;
    CHECK_THROWS_AS(JointCoordination{config}, std::invalid_argument);
}
