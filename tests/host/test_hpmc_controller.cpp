#include <doctest/doctest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>

#include "allocation_counter.h"
#include "hpmc/hpmc_controller.h"
#include "random_values.h"

using namespace hpmc;

namespace {

const Eigen::Vector2d home{0.3, 0.0};
const Eigen::Vector2d target{0.3, 0.1};
const Eigen::Vector2d no_wrench{0.0, 0.0};
const PlanarArm arm{PlanarArmConfig{}};
const Eigen::Vector3d q_home = arm.inverse(home, 155.0 * M_PI / 180.0).q_rad;

bool all_finite(const HpmcOutput &out) {
    bool finite = out.x_d_m.allFinite() && out.v_d_m_s.allFinite() && std::isfinite(out.phi_rad) &&
                  out.q_d_rad.allFinite() && out.wrench_N.allFinite() && out.tau_d_Nm.allFinite() &&
                  out.tau_max_Nm.allFinite();
    for (const Link link : {elbow, wrist, hand}) {
        finite = finite && out.x_link_d_m[link].allFinite() && out.x_link_m[link].allFinite() &&
                 out.w_link_N[link].allFinite();
    }
    return finite;
}

} // namespace

TEST_CASE("one step carries each layer's output to the next") {
    HpmcController controller{HpmcConfig{}};
    controller.reset(home, q_home);
    const Eigen::Vector3d q = q_home + Eigen::Vector3d(0.002, -0.003, 0.004);
    const Eigen::Vector2d w(2.0, -1.0);
    const HpmcOutput out = controller.step({target, q, w});

    CHECK((out.x_d_m - home).norm() == doctest::Approx(0.5223e-6));
    CHECK((out.v_d_m_s - Eigen::Vector2d(0.0, 0.5223e-3)).norm() < 1e-12);
    const LinkEnds desired = arm.link_ends(out.q_d_rad);
    const LinkEnds actual = arm.link_ends(q);
    CHECK((desired[hand] - out.x_d_m).norm() < 1e-12);
    CHECK(out.phi_rad == doctest::Approx(155.0 * M_PI / 180.0));
    const Eigen::Vector3d stiffness_N_m(11000.0, 25000.0, 14000.0);
    for (const Link link : {elbow, wrist, hand}) {
        CHECK(out.x_link_d_m[link] == desired[link]);
        CHECK(out.x_link_m[link] == actual[link]);
        const auto i = static_cast<Eigen::Index>(link);
        CHECK(out.w_link_N[link].isApprox(stiffness_N_m[i] * (desired[link] - actual[link])));
    }
    CHECK(out.wrench_N.isApprox((1.0 - std::exp(-0.2 * M_PI)) * w));
    const LinkJacobian j_hand = PlanarArm::jacobian(actual, hand);
    CHECK(out.tau_d_Nm.isApprox(j_hand.transpose() * (2.0 * out.w_link_N[hand] - out.wrench_N)));
    CHECK(out.tau_max_Nm[2] ==
          doctest::Approx(2.0 * std::abs(j_hand.col(2).dot(out.w_link_N[hand]))));
}

TEST_CASE("in free motion T_max of the hand equals |T_d|: one plateau (erratum 5)") {
    test::Random random(14);
    HpmcController controller{HpmcConfig{}};
    controller.reset(home, q_home);
    for (int n = 0; n < 1000; ++n) {
        const Eigen::Vector3d q = q_home + random.vector3(-0.01, 0.01);
        const HpmcOutput out = controller.step({target, q, no_wrench});
        REQUIRE(out.tau_max_Nm[2] ==
                doctest::Approx(std::min(5.0, std::abs(out.tau_d_Nm[2]))).epsilon(1e-9));
    }
}

TEST_CASE("finite input gives finite output, both postures, far out of reach too") {
    test::Random random(15);
    for (const Posture posture : {Posture::paper, Posture::optimal}) {
        HpmcConfig config;
        config.dynamic_task.posture = posture;
        HpmcController controller{config};
        controller.reset(home, q_home);
        for (int n = 0; n < 5000; ++n) {
            const HpmcInput input{random.on_ring(0.0, n % 100 == 0 ? 1e6 : 0.7),
                                  random.vector3(-10.0, 10.0), random.on_ring(0.0, 1e4)};
            const HpmcOutput out = controller.step(input);
            REQUIRE(all_finite(out));
            REQUIRE((out.tau_max_Nm.array() <= Eigen::Array3d(30.0, 20.0, 5.0)).all());
        }
    }
}

TEST_CASE("NaN in any input gives NaN in the torques; reset recovers") {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const HpmcInput lost[] = {
        {{nan, 0.0}, q_home, no_wrench},
        {target, {q_home[0], nan, q_home[2]}, no_wrench},
        {target, q_home, {0.0, nan}},
    };
    HpmcController controller{HpmcConfig{}};
    for (const HpmcInput &input : lost) {
        controller.reset(home, q_home);
        CHECK_FALSE(controller.step(input).tau_d_Nm.allFinite());
        controller.reset(home, q_home);
        CHECK(all_finite(controller.step({target, q_home, no_wrench})));
    }
}

TEST_CASE("W_t by message reaches the dynamic task") {
    HpmcController controller{HpmcConfig{}};
    controller.reset(home, q_home);
    controller.set_task_direction(150.0 * M_PI / 180.0);
    Eigen::Vector3d q = q_home;
    HpmcOutput out;
    for (int tick = 0; tick < 200; ++tick) {
        out = controller.step({home, q, no_wrench});
        q = out.q_d_rad;
    }
    CHECK(out.phi_rad == doctest::Approx(150.0 * M_PI / 180.0));
}

TEST_CASE("the counter of allocations counts") {
    const long before = test::allocations();
    const auto owned = std::make_unique<int>(1);
    void *raw = std::malloc(8);
    CHECK(test::allocations() - before == 2);
    CHECK(raw != nullptr);
    std::free(raw);
}

TEST_CASE("a step allocates nothing, in both postures") {
    for (const Posture posture : {Posture::paper, Posture::optimal}) {
        HpmcConfig config;
        config.dynamic_task.posture = posture;
        HpmcController controller{config};
        controller.reset(home, q_home);
        const long before = test::allocations();
        for (int tick = 0; tick < 100; ++tick) {
            controller.step({target, q_home, no_wrench});
        }
        CHECK(test::allocations() == before);
    }
}

// Unoptimised and instrumented builds answer other questions.
#if defined(__SANITIZE_ADDRESS__)
#define INSTRUMENTED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define INSTRUMENTED
#endif
#endif
#if defined(__OPTIMIZE__) && !defined(INSTRUMENTED)
TEST_CASE("a step takes less than 2 us with the paper's posture") {
    using clock = std::chrono::steady_clock;
    HpmcController controller{HpmcConfig{}};
    controller.reset(home, q_home);
    Eigen::Vector3d q = q_home;
    double best_us = 1e9;
    for (int batch = 0; batch < 50; ++batch) {
        const auto start = clock::now();
        for (int tick = 0; tick < 1000; ++tick) {
            q = controller.step({batch % 2 == 0 ? target : home, q, no_wrench}).q_d_rad;
        }
        const std::chrono::duration<double, std::micro> took = clock::now() - start;
        best_us = std::min(best_us, took.count() / 1000.0);
    }
    MESSAGE("HpmcController::step: " << best_us << " us");
    CHECK(best_us < 2.0);
}
#endif
