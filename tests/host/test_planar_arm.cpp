#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "hpmc/planar_arm.h"
#include "random_values.h"

using namespace hpmc;

namespace {

const PlanarArm arm{PlanarArmConfig{}};

Eigen::Vector2d direction(double angle_rad) {
    return {std::cos(angle_rad), std::sin(angle_rad)};
}

} // namespace

TEST_CASE("link ends of poses that can be read off the links' lengths") {
    const LinkEnds straight = arm.link_ends({0.0, 0.0, 0.0});
    CHECK(straight[elbow].isApprox(Eigen::Vector2d(0.282, 0.0)));
    CHECK(straight[wrist].isApprox(Eigen::Vector2d(0.551, 0.0)));
    CHECK(straight[hand].isApprox(Eigen::Vector2d(0.595, 0.0)));
    const LinkEnds folded = arm.link_ends({-M_PI / 2.0, M_PI / 2.0, M_PI / 2.0});
    CHECK((folded[elbow] - Eigen::Vector2d(0.0, -0.282)).norm() < 1e-15);
    CHECK((folded[wrist] - Eigen::Vector2d(0.269, -0.282)).norm() < 1e-15);
    CHECK((folded[hand] - Eigen::Vector2d(0.269, -0.238)).norm() < 1e-15);
}

TEST_CASE("Jacobians of elbow, wrist and hand equal finite differences") {
    test::Random random(1);
    constexpr double h = 1e-6;
    for (int n = 0; n < 2000; ++n) {
        const Eigen::Vector3d q = random.vector3(-2.0 * M_PI, 2.0 * M_PI);
        const LinkEnds ends = arm.link_ends(q);
        for (const Link link : {elbow, wrist, hand}) {
            const LinkJacobian jacobian = PlanarArm::jacobian(ends, link);
            for (Eigen::Index joint = 0; joint < 3; ++joint) {
                const Eigen::Vector3d dq = h * Eigen::Vector3d::Unit(joint);
                const Eigen::Vector2d slope =
                    (arm.link_ends(q + dq)[link] - arm.link_ends(q - dq)[link]) / (2.0 * h);
                REQUIRE((jacobian.col(joint) - slope).norm() < 1e-9);
            }
        }
    }
}

TEST_CASE("inverse kinematics: round trip over the whole workspace, elbow on the right") {
    test::Random random(2);
    int reached = 0;
    for (int n = 0; n < 20000; ++n) {
        const Eigen::Vector2d x = random.on_ring(0.0, 0.6);
        const double phi = random.uniform(-2.0 * M_PI, 2.0 * M_PI);
        const InverseKinematics inverse = arm.inverse(x, phi);
        REQUIRE(inverse.q_rad.allFinite());
        REQUIRE(std::abs(inverse.q_rad.sum() - phi) < 1e-12);
        REQUIRE(inverse.q_rad[1] >= -1e-12);
        REQUIRE(inverse.q_rad[1] <= M_PI + 1e-12);
        const double wrist_m = (x - 0.044 * direction(phi)).norm();
        const bool reachable = wrist_m >= 0.013 && wrist_m <= 0.551;
        REQUIRE(inverse.saturated == !reachable);
        if (reachable) {
            ++reached;
            REQUIRE((arm.link_ends(inverse.q_rad)[hand] - x).norm() < 1e-12);
        }
    }
    CHECK(reached > 15000);
}

TEST_CASE("inverse kinematics: joint angles come back") {
    test::Random random(3);
    for (int n = 0; n < 5000; ++n) {
        Eigen::Vector3d q = random.vector3(-M_PI, M_PI);
        q[1] = random.uniform(0.01, M_PI - 0.01);
        const InverseKinematics inverse = arm.inverse(arm.link_ends(q)[hand], q.sum());
        CHECK_FALSE(inverse.saturated);
        for (Eigen::Index i = 0; i < 3; ++i) {
            REQUIRE(std::abs(std::remainder(inverse.q_rad[i] - q[i], 2.0 * M_PI)) < 1e-10);
        }
    }
}

TEST_CASE("inverse kinematics: both edges of the ring, just inside and just outside") {
    test::Random random(4);
    for (int n = 0; n < 1000; ++n) {
        const double bearing = random.uniform(-M_PI, M_PI);
        const double phi = random.uniform(-M_PI, M_PI);
        for (const double edge_m : {0.013, 0.551}) {
            for (const double beside_m : {-1e-6, -1e-12, 0.0, 1e-12, 1e-6}) {
                const Eigen::Vector2d x =
                    (edge_m + beside_m) * direction(bearing) + 0.044 * direction(phi);
                const InverseKinematics inverse = arm.inverse(x, phi);
                REQUIRE(inverse.q_rad.allFinite());
                REQUIRE((arm.link_ends(inverse.q_rad)[hand] - x).norm() < 1.1e-6);
                const bool outside = edge_m > 0.1 ? beside_m == 1e-6 : beside_m == -1e-6;
                REQUIRE(inverse.saturated == outside);
            }
        }
    }
}

TEST_CASE("inverse kinematics: a wrist out of reach keeps its direction") {
    test::Random random(5);
    for (int n = 0; n < 1000; ++n) {
        const double bearing = random.uniform(-M_PI, M_PI);
        const double phi = random.uniform(-M_PI, M_PI);
        for (const double distance_m : {1e-9, 0.005, 0.56, 3.0, 1e150}) {
            const Eigen::Vector2d x = distance_m * direction(bearing) + 0.044 * direction(phi);
            const InverseKinematics inverse = arm.inverse(x, phi);
            REQUIRE(inverse.saturated);
            const double edge_m = distance_m < 0.1 ? 0.013 : 0.551;
            const Eigen::Vector2d wrist_m = arm.link_ends(inverse.q_rad)[wrist];
            REQUIRE((wrist_m - edge_m * direction(bearing)).norm() < 1e-7);
        }
    }
}

TEST_CASE("inverse kinematics: never NaN for finite input, NaN for NaN") {
    // The wrist exactly on the shoulder has no direction.
    CHECK(arm.inverse(Eigen::Vector2d(0.044, 0.0), 0.0).q_rad.allFinite());
    CHECK(arm.inverse(Eigen::Vector2d(0.0, 0.0), 0.0).q_rad.allFinite());
    const PlanarArm equal_links{PlanarArmConfig{{0.3, 0.3, 0.1}}};
    CHECK(equal_links.inverse(Eigen::Vector2d(0.1, 0.0), 0.0).q_rad.allFinite());
    const double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(arm.inverse(Eigen::Vector2d(nan, 0.0), 0.0).q_rad.allFinite());
    CHECK_FALSE(arm.inverse(Eigen::Vector2d(0.3, 0.0), nan).q_rad.allFinite());
}

TEST_CASE("manipulability of the clock: home .0690, least at targets 5 and 6") {
    const auto at = [](double x, double y) {
        const InverseKinematics inverse = arm.inverse(Eigen::Vector2d(x, y), 155.0 * M_PI / 180.0);
        return manipulability(PlanarArm::jacobian(arm.link_ends(inverse.q_rad), hand));
    };
    CHECK(at(0.3, 0.0) == doctest::Approx(0.0690).epsilon(1e-3));
    const auto target = [&](int i) {
        const double angle = (i - 1) * M_PI / 4.0;
        return at(0.3 + 0.1 * std::cos(angle), 0.1 * std::sin(angle));
    };
    CHECK(target(5) == doctest::Approx(0.0529).epsilon(1e-3));
    CHECK(target(6) == doctest::Approx(0.0584).epsilon(1e-3));
    for (const int other : {1, 2, 3, 4, 7, 8}) {
        CHECK(target(other) > target(6));
    }
}

TEST_CASE("links without length are refused") {
    CHECK_THROWS_AS(PlanarArm(PlanarArmConfig{{0.282, 0.0, 0.044}}), std::invalid_argument);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(PlanarArm(PlanarArmConfig{{0.282, nan, 0.044}}), std::invalid_argument);
}
