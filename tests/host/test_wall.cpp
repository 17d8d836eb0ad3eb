#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "closed_loop.h"
#include "exact_arm.h"
#include "hpmc/planar_arm.h"
#include "plant/arm_plant.h"

using namespace hpmc;

namespace {

constexpr double tick_s = 1e-3;
const Eigen::Vector3d no_torque{0.0, 0.0, 0.0};

WallConfig wall(double stiffness_N_m, double damping_N_s_m) {
    WallConfig config;
    config.surface = WallConfig::Surface::plane;
    config.stiffness_N_m = stiffness_N_m;
    config.damping_N_s_m = damping_N_s_m;
    return config;
}

ArmPlantConfig frictionless(const WallConfig &wall) {
    ArmPlantConfig config;
    config.joint_friction_Nm_s_rad = 0.0;
    config.wall = wall;
    return config;
}

Eigen::Vector3d home_rad() {
    return PlanarArm(PlanarArmConfig{}).inverse({0.3, 0.0}, 155.0 * M_PI / 180.0).q_rad;
}

/// A push of 50 ms toward the wall, then the arm drifts into it and bounces; `each` sees every
/// tick.
template <class F> void throw_at_the_wall(ArmPlant &plant, F &&each) {
    const PlanarArm arm{PlanarArmConfig{}};
    plant.reset(home_rad());
    for (int tick = 0; tick < 1500; ++tick) {
        const LinkJacobian jacobian = PlanarArm::jacobian(arm.link_ends(home_rad()), hand);
        const Eigen::Vector3d push = jacobian.transpose() * Eigen::Vector2d(4.0, 0.0);
        plant.advance(tick < 50 ? push : no_torque, tick_s);
        each(tick, plant.state());
    }
}

} // namespace

TEST_CASE("the wall is a spring that pushes along its normal and never pulls") {
    for (const double stiffness : {1e3, 1e4, 1e5}) {
        CAPTURE(stiffness);
        ArmPlant plant{frictionless(wall(stiffness, 0.0))};
        double largest_N = 0.0;
        int touching = 0;
        throw_at_the_wall(plant, [&](int, const ArmPlantState &state) {
            const double depth_m = state.hand_m.x() - 0.35;
            const double force_N = state.wrench_N.x();
            largest_N = std::max(largest_N, force_N);
            touching += force_N > 0.0 ? 1 : 0;
            REQUIRE(force_N >= 0.0);
            REQUIRE(std::abs(state.wrench_N.y()) < 1e-9);
            // In the step in which the hand comes to touch or leaves, one of both is zero.
            if (force_N > 0.0 && depth_m > 0.0) {
                REQUIRE(std::abs(force_N - stiffness * depth_m) < 0.002 * stiffness * 1e-3 + 1e-3);
            }
            if (depth_m < -1e-4) {
                REQUIRE(force_N == 0.0);
            }
        });
        MESSAGE(stiffness << " N/m: peak " << largest_N << " N, touching " << touching << " ms");
        CHECK(largest_N > 1.0);
        CHECK(touching > 5);
    }
}

TEST_CASE("a wall gives back no more energy than it was given, and less with damping") {
    for (const double stiffness : {1e3, 1e4, 1e5}) {
        CAPTURE(stiffness);
        double after_J[2];
        double before_J = 0.0;
        for (const int damped : {0, 1}) {
            const ArmPlantConfig config = frictionless(wall(stiffness, damped * 100.0));
            ArmPlant plant{config};
            const test::ExactArm exact{config};
            throw_at_the_wall(plant, [&](int tick, const ArmPlantState &state) {
                const double depth_m = std::max(state.hand_m.x() - 0.35, 0.0);
                const double energy_J = exact.energy_J(state.q_rad, state.qd_rad_s) +
                                        0.5 * stiffness * depth_m * depth_m;
                if (tick == 60) {
                    before_J = energy_J;
                }
                if (tick > 60) {
                    REQUIRE(energy_J < before_J * 1.005);
                }
                after_J[damped] = energy_J;
            });
        }
        MESSAGE(stiffness << " N/m: " << before_J << " J, after the bounces " << after_J[0]
                          << " J, with damping " << after_J[1] << " J");
        CHECK(after_J[1] < 0.98 * after_J[0]);
    }
}

TEST_CASE("a wall that is not touched changes no bit of the motion") {
    WallConfig far = wall(1e5, 100.0);
    far.point_m = {0.9, 0.0};
    ArmPlant with{frictionless(far)};
    ArmPlant without{frictionless(WallConfig{})};
    with.reset(home_rad());
    without.reset(home_rad());
    for (int tick = 0; tick < 500; ++tick) {
        const Eigen::Vector3d tau(0.5 - 0.002 * tick, -0.3, 0.02);
        with.advance(tau, tick_s);
        without.advance(tau, tick_s);
        REQUIRE(with.state().q_rad == without.state().q_rad);
        REQUIRE(with.state().qd_rad_s == without.state().qd_rad_s);
        REQUIRE(with.state().wrench_N.isZero());
    }
}

TEST_CASE("a wall stands as its normal says: the hand is kept off from the left, too") {
    WallConfig left = wall(1e4, 50.0);
    left.point_m = {0.25, 0.0};
    left.normal_rad = 0.0;
    const test::Press press = test::press_wall(left, {0.245, 0.0}, 1.0);
    CHECK(press.rest_N > 5.0);
    CHECK(press.rest_depth_m == doctest::Approx(press.rest_N / 1e4).epsilon(0.01));
}

TEST_CASE("after reset a plant that was pressed against its wall runs like a fresh one") {
    ArmPlant used{frictionless(wall(1e4, 50.0))};
    throw_at_the_wall(used, [](int, const ArmPlantState &) {});
    ArmPlant fresh{frictionless(wall(1e4, 50.0))};
    std::vector<ArmPlantState> states;
    throw_at_the_wall(fresh, [&](int, const ArmPlantState &state) { states.push_back(state); });
    throw_at_the_wall(used, [&](int tick, const ArmPlantState &state) {
        const ArmPlantState &expected = states[static_cast<std::size_t>(tick)];
        REQUIRE(state.q_rad == expected.q_rad);
        REQUIRE(state.wrench_N == expected.wrench_N);
    });
}

TEST_CASE("parameters of the wall out of range are refused") {
    const auto refused = [](auto change) {
        ArmPlantConfig config;
        change(config.wall);
        CHECK_THROWS_AS(ArmPlant{config}, std::invalid_argument);
    };
    refused([](WallConfig &config) { config.stiffness_N_m = 999.0; });
    refused([](WallConfig &config) { config.stiffness_N_m = 1.1e5; });
    refused([](WallConfig &config) { config.damping_N_s_m = -1.0; });
    refused([](WallConfig &config) { config.damping_N_s_m = 1001.0; });
    refused(
        [](WallConfig &config) { config.normal_rad = std::numeric_limits<double>::infinity(); });
    refused(
        [](WallConfig &config) { config.point_m.x() = std::numeric_limits<double>::quiet_NaN(); });
}

TEST_CASE("pressed against a wall of 1e3 to 1e5 N/m the hand stays on it") {
    for (const double stiffness : {1e3, 1e4, 1e5}) {
        const test::Press press = test::press_wall(wall(stiffness, 100.0), {0.355, 0.0}, 1.0);
        MESSAGE(stiffness << " N/m: peak " << press.peak_N << " N, at rest " << press.rest_N
                          << " N, " << 1e3 * press.rest_depth_m << " mm deep, breaks "
                          << press.breaks);
        CHECK(press.late_breaks == 0);
        CHECK(press.breaks <= 8);
        CHECK(press.rest_N > 3.0);
        CHECK(press.rest_N < 120.0);
        CHECK(press.rest_depth_m == doctest::Approx(press.rest_N / stiffness).epsilon(0.01));
    }
}

// In free motion W = 0 and its sign shows nowhere. Against a wall T_d = J'(2 W_d - W) yields to the
// contact force, J'(2 W_d + W) presses on. The loop is run as it is, without the sensor, and with
// the sensor turned round: if the sign of W were turned in the joint coordination, the first and
// the last would change places.
TEST_CASE("the measured wrench makes the hand press less: the sign of W") {
    for (const double stiffness : {1e4, 3e4}) {
        CAPTURE(stiffness);
        const auto rest_N = [&](double wrench_gain) {
            return test::press_wall(wall(stiffness, 100.0), {0.355, 0.0}, wrench_gain).rest_N;
        };
        const double as_is = rest_N(1.0);
        const double without = rest_N(0.0);
        const double turned = rest_N(-1.0);
        MESSAGE(stiffness << " N/m, force at rest: with W " << as_is << " N, without " << without
                          << " N, with W turned round " << turned << " N");
        CHECK(as_is < 0.95 * without);
        CHECK(as_is < 0.92 * turned);
    }
}
