/**
 * Speed of the plant and of the host layers: bare dWorldStep on the same bodies against
 * ArmPlant::advance, and HpmcController::step.
 */
#include <ode/ode.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "hpmc/hpmc_controller.h"
#include "plant/arm_plant.h"

namespace {

constexpr int rounds = 7;
constexpr double step_s = 0.0002;

/// Best of several rounds, in calls per second.
template <class Call> double rate_per_s(int calls, Call &&call) {
    using clock = std::chrono::steady_clock;
    double best_s = 1e9;
    for (int round = 0; round < rounds; ++round) {
        const auto start = clock::now();
        for (int i = 0; i < calls; ++i) {
            call(i);
        }
        best_s = std::min(best_s, std::chrono::duration<double>(clock::now() - start).count());
    }
    return calls / best_s;
}

double bare_steps_per_s() {
    const hpmc::ArmPlantConfig config;
    const dWorldID world = dWorldCreate();
    dWorldSetERP(world, 1.0);
    dWorldSetCFM(world, 0.0);
    dBodyID before = nullptr;
    double joint_m = 0.0;
    for (Eigen::Index i = 0; i < 3; ++i) {
        const double length_m = config.length_m[i];
        const double inertia = config.mass_kg[i] * length_m * length_m / 12.0;
        dMass mass;
        dMassSetParameters(&mass, config.mass_kg[i], 0, 0, 0, inertia, inertia, inertia, 0, 0, 0);
        const dBodyID body = dBodyCreate(world);
        dBodySetMass(body, &mass);
        dBodySetPosition(body, joint_m + length_m / 2.0, 0.0, 0.0);
        dBodySetFiniteRotationMode(body, 1);
        const dJointID hinge = dJointCreateHinge(world, nullptr);
        dJointAttach(hinge, body, before);
        dJointSetHingeAnchor(hinge, joint_m, 0.0, 0.0);
        dJointSetHingeAxis(hinge, 0.0, 0.0, 1.0);
        before = body;
        joint_m += length_m;
    }
    dBodyAddTorque(before, 0.0, 0.0, 0.1);
    const double rate = rate_per_s(100000, [&](int) { dWorldStep(world, step_s); });
    dWorldDestroy(world);
    return rate;
}

double plant_steps_per_s() {
    hpmc::ArmPlant plant{hpmc::ArmPlantConfig{}};
    plant.reset({-0.8, 1.9, 0.7});
    double sum = 0.0;
    const double ticks = rate_per_s(20000, [&](int i) {
        plant.advance({0.01 * std::sin(0.01 * i), 0.0, 0.0}, 1e-3);
        sum += plant.state().q_rad[0];
    });
    return std::isfinite(sum) ? 5.0 * ticks : 0.0;
}

double host_steps_per_s(hpmc::Posture posture) {
    hpmc::HpmcConfig config;
    config.dynamic_task.posture = posture;
    hpmc::HpmcController host{config};
    const Eigen::Vector2d home(0.3, 0.0);
    Eigen::Vector3d q =
        hpmc::PlanarArm{config.arm}.inverse(home, config.dynamic_task.w_t_rad).q_rad;
    host.reset(home, q);
    return rate_per_s(20000, [&](int i) {
        const Eigen::Vector2d target(0.3, i / 1000 % 2 == 0 ? 0.1 : 0.0);
        q = host.step({target, q, Eigen::Vector2d::Zero()}).q_d_rad;
    });
}

} // namespace

int main() {
    dInitODE2(0);
    const double bare = bare_steps_per_s();
    const double plant = plant_steps_per_s();
    std::printf("bare dWorldStep       %8.0f steps/s\n", bare);
    std::printf("ArmPlant::advance     %8.0f steps/s, %.2f times the bare time\n", plant,
                bare / plant);
    std::printf("HpmcController::step  %8.2f us (paper), %.2f us (optimal)\n",
                1e6 / host_steps_per_s(hpmc::Posture::paper),
                1e6 / host_steps_per_s(hpmc::Posture::optimal));
    dCloseODE();
    return 0;
}
