#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

#include "closed_loop.h"
#include "exact_arm.h"
#include "hpmc/planar_arm.h"
#include "plant/arm_plant.h"
#include "random_values.h"

using namespace hpmc;

namespace {

constexpr double tick_s = 1e-3;
const Eigen::Vector3d bent{-0.8, 1.9, 0.7};
const Eigen::Vector3d no_torque{0.0, 0.0, 0.0};
const Eigen::Vector2d no_force{0.0, 0.0};

ArmPlantConfig with_step(double step_s) {
    ArmPlantConfig config;
    config.step_s = step_s;
    return config;
}

struct Recording {
    Eigen::Vector3d q_start_rad;
    std::vector<Eigen::Vector3d> torques_Nm;
};

/// One second of torques of the clock experiment: the reach to target 2, as it was run.
const Recording &recorded() {
    static const Recording recording = [] {
        const test::ClosedLoopRun run =
            test::run_clock(PhaseRule::body_motion, Eigen::Vector3d::Zero());
        return Recording{run.q_start_rad,
                         {run.torques_Nm.begin() + 3000, run.torques_Nm.begin() + 4000}};
    }();
    return recording;
}

/// RMS over the joints and ticks of a second of the angle's deviation from the exact motion under
/// the recorded torques times scale.
double angle_rms_rad(double step_s, double scale) {
    ArmPlant plant{with_step(step_s)};
    test::ExactArm exact{with_step(step_s)};
    plant.reset(recorded().q_start_rad);
    exact.reset(recorded().q_start_rad);
    double sum = 0.0;
    for (const Eigen::Vector3d &tau : recorded().torques_Nm) {
        plant.advance(scale * tau, tick_s);
        exact.advance(scale * tau, no_force, tick_s, 20);
        sum += (plant.state().q_rad - exact.q_rad()).squaredNorm();
    }
    return std::sqrt(sum / (3.0 * static_cast<double>(recorded().torques_Nm.size())));
}

bool same_bits(const ArmPlantState &a, const ArmPlantState &b) {
    const auto same = [](const auto &u, const auto &v) {
        return std::memcmp(u.data(), v.data(), sizeof(u)) == 0;
    };
    return same(a.q_rad, b.q_rad) && same(a.qd_rad_s, b.qd_rad_s) && same(a.hand_m, b.hand_m) &&
           same(a.hand_m_s, b.hand_m_s) && same(a.wrench_N, b.wrench_N);
}

} // namespace

TEST_CASE("exact integration is exact enough: halving its step changes nothing that counts") {
    test::ExactArm coarse{ArmPlantConfig{}};
    test::ExactArm fine{ArmPlantConfig{}};
    coarse.reset(recorded().q_start_rad);
    fine.reset(recorded().q_start_rad);
    for (const Eigen::Vector3d &tau : recorded().torques_Nm) {
        coarse.advance(tau, no_force, tick_s, 20);
        fine.advance(tau, no_force, tick_s, 40);
    }
    CHECK((coarse.q_rad() - fine.q_rad()).cwiseAbs().maxCoeff() < 1e-9);
}

TEST_CASE("recorded torques over 1 s: angles within 5e-5 rad RMS at 0.2 ms, second order") {
    double largest_Nm = 0.0;
    for (const Eigen::Vector3d &tau : recorded().torques_Nm) {
        largest_Nm = std::max(largest_Nm, tau.cwiseAbs().maxCoeff());
    }
    CHECK(largest_Nm > 0.5);

    // As they were, and five times that, which takes the arm halfway round.
    for (const double scale : {1.0, 5.0}) {
        const double at_500_us = angle_rms_rad(0.0005, scale);
        const double at_200_us = angle_rms_rad(0.0002, scale);
        const double at_100_us = angle_rms_rad(0.0001, scale);
        MESSAGE("torques times " << scale << ", angle RMS error, rad: 0.5 ms " << at_500_us
                                 << ", 0.2 ms " << at_200_us << ", 0.1 ms " << at_100_us);
        CHECK(at_200_us < 5e-5);
        CHECK(at_500_us / at_100_us == doctest::Approx(25.0).epsilon(0.2));
        CHECK(at_200_us / at_100_us == doctest::Approx(4.0).epsilon(0.2));
    }
}

TEST_CASE("free motion without friction keeps its energy to 1e-5 for 1 s") {
    for (const double step_s : {0.0001, 0.0002}) {
        ArmPlantConfig config = with_step(step_s);
        config.joint_friction_Nm_s_rad = 0.0;
        ArmPlant plant{config};
        const test::ExactArm exact{config};
        plant.reset(bent);
        for (int tick = 0; tick < 100; ++tick) {
            plant.advance({0.8, -0.3, 0.01}, tick_s);
        }
        plant.advance(no_torque, tick_s);
        ArmPlantState state = plant.state();
        const double start_J = exact.energy_J(state.q_rad, state.qd_rad_s);
        double drift = 0.0;
        for (int tick = 0; tick < 1000; ++tick) {
            plant.advance(no_torque, tick_s);
            state = plant.state();
            drift = std::max(drift,
                             std::abs(exact.energy_J(state.q_rad, state.qd_rad_s) / start_J - 1.0));
        }
        MESSAGE("energy " << start_J << " J, rates " << state.qd_rad_s.transpose()
                          << " rad/s, relative drift " << drift << " at " << step_s << " s");
        CHECK(start_J > 0.01);
        CHECK(drift < 1e-5);
    }
}

TEST_CASE("friction takes exactly the energy it should") {
    ArmPlantConfig config;
    config.joint_friction_Nm_s_rad = 0.5;
    ArmPlant plant{config};
    test::ExactArm exact{config};
    plant.reset(bent);
    exact.reset(bent);
    for (int tick = 0; tick < 500; ++tick) {
        const Eigen::Vector3d tau = tick < 100 ? Eigen::Vector3d(2.0, -1.0, 0.1) : no_torque;
        plant.advance(tau, tick_s);
        exact.advance(tau, no_force, tick_s, 20);
        REQUIRE((plant.state().q_rad - exact.q_rad()).norm() < 1e-4);
    }
    CHECK((exact.q_rad() - bent).norm() > 0.01);
}

TEST_CASE("rates and hand velocity belong to the same instant as the angles") {
    ArmPlant plant{ArmPlantConfig{}};
    test::ExactArm exact{ArmPlantConfig{}};
    const PlanarArm arm{PlanarArmConfig{}};
    plant.reset(bent);
    exact.reset(bent);
    for (int tick = 0; tick < 300; ++tick) {
        const Eigen::Vector3d tau(std::sin(0.02 * tick), -0.5, 0.02 * std::cos(0.05 * tick));
        plant.advance(tau, tick_s);
        exact.advance(tau, no_force, tick_s, 20);
        const ArmPlantState state = plant.state();
        // Half a step late would be 1e-4 s times some 30 rad/s^2.
        REQUIRE((state.qd_rad_s - exact.qd_rad_s()).norm() < 3e-4);
        const LinkEnds ends = arm.link_ends(state.q_rad);
        REQUIRE((state.hand_m - ends[hand]).norm() < 1e-12);
        REQUIRE((state.hand_m_s - PlanarArm::jacobian(ends, hand) * state.qd_rad_s).norm() < 1e-12);
    }
}

TEST_CASE("a force on the hand acts as J' F; the wrench is the hand's force on its environment") {
    ArmPlant plant{ArmPlantConfig{}};
    test::ExactArm exact{ArmPlantConfig{}};
    plant.reset(bent);
    exact.reset(bent);
    const Eigen::Vector2d force(0.6, -0.4);
    plant.set_external_force(force);
    for (int tick = 0; tick < 300; ++tick) {
        plant.advance(no_torque, tick_s);
        exact.advance(no_torque, force, tick_s, 20);
        REQUIRE((plant.state().q_rad - exact.q_rad()).norm() < 1e-4);
    }
    CHECK((exact.q_rad() - bent).norm() > 0.1);
    CHECK(plant.state().wrench_N == -force);
    plant.reset(bent);
    CHECK(plant.state().wrench_N.isZero());
}

TEST_CASE("angles run on across full turns") {
    ArmPlant plant{ArmPlantConfig{}};
    test::ExactArm exact{ArmPlantConfig{}};
    plant.reset(bent);
    exact.reset(bent);
    for (int tick = 0; tick < 2000; ++tick) {
        const Eigen::Vector3d tau(3.0, 0.2, 0.01);
        plant.advance(tau, tick_s);
        exact.advance(tau, no_force, tick_s, 20);
        REQUIRE((plant.state().q_rad - exact.q_rad()).norm() < 0.01);
    }
    CHECK(exact.q_rad()[0] > 2.0 * M_PI);
}

TEST_CASE("reset: the pose, at rest, whatever turn it is on") {
    ArmPlant plant{ArmPlantConfig{}};
    for (const Eigen::Vector3d &q :
         {bent, Eigen::Vector3d(-3.1, 3.1, 3.1), Eigen::Vector3d(7.0, -8.0, 9.0)}) {
        plant.reset(q);
        CHECK((plant.state().q_rad - q).cwiseAbs().maxCoeff() < 1e-14);
        CHECK(plant.state().qd_rad_s.isZero());
        plant.advance(no_torque, tick_s);
        CHECK((plant.state().q_rad - q).cwiseAbs().maxCoeff() < 1e-12);
    }
}

TEST_CASE("after reset a used plant runs bit for bit like a fresh one") {
    test::Random random(16);
    ArmPlant used{ArmPlantConfig{}};
    used.set_external_force({5.0, 3.0});
    for (int tick = 0; tick < 200; ++tick) {
        used.advance(random.vector3(-3.0, 3.0), tick_s);
    }
    ArmPlant fresh{ArmPlantConfig{}};
    used.reset(bent);
    fresh.reset(bent);
    for (int tick = 0; tick < 2000; ++tick) {
        REQUIRE(same_bits(used.state(), fresh.state()));
        const Eigen::Vector3d tau = random.vector3(-3.0, 3.0);
        used.advance(tau, tick_s);
        fresh.advance(tau, tick_s);
    }
}

TEST_CASE("five advances of 0.2 ms equal one of 1 ms bit for bit") {
    ArmPlant once{ArmPlantConfig{}};
    ArmPlant five{ArmPlantConfig{}};
    once.reset(bent);
    five.reset(bent);
    for (int tick = 0; tick < 100; ++tick) {
        const Eigen::Vector3d tau(1.0 - 0.01 * tick, 0.3, -0.02);
        once.advance(tau, tick_s);
        for (int part = 0; part < 5; ++part) {
            five.advance(tau, 0.2e-3);
        }
        REQUIRE(same_bits(once.state(), five.state()));
    }
}

TEST_CASE("parameters out of range are refused") {
    const auto refused = [](auto change) {
        ArmPlantConfig config;
        change(config);
        CHECK_THROWS_AS(ArmPlant{config}, std::invalid_argument);
    };
    refused([](ArmPlantConfig &config) { config.length_m[1] = 0.0; });
    refused([](ArmPlantConfig &config) { config.mass_kg[2] = -1.0; });
    refused([](ArmPlantConfig &config) { config.joint_friction_Nm_s_rad = -0.1; });
    refused([](ArmPlantConfig &config) { config.step_s = 0.002; });
    refused(
        [](ArmPlantConfig &config) { config.step_s = std::numeric_limits<double>::quiet_NaN(); });
}
