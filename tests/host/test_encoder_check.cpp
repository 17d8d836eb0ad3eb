#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <functional>
#include <string>

#include "host/encoder_check.h"
#include "link/bus_closing.h"
#include "node_bench.h"

extern "C" {
#include "node/motor_node.h"
#include "port/posix/simulated_joint.h"
}

using namespace hpmc;

namespace {

/// Three nodes with joints that move, on a bus; each node takes ten joint ticks a SYNC.
class Joints {
  public:
    explicit Joints(const std::vector<std::string> &overrides = {})
        : config(test::clock_config(with_defaults(overrides))), check(config) {
        const Eigen::Vector3d home_rad = home_pose_rad(config);
        for (std::size_t i = 0; i < kJoints; ++i) {
            joints[i] = {.inertia_kg_m2 = 0.05,
                         .viscous_Nm_s = 0.05,
                         .coulomb_Nm = 0.05,
                         .torque_constant_Nm_A = 5.0,
                         .index_rad = 100.0,
                         .increments_per_revolution = 65536,
                         .angle_rad = home_rad[static_cast<Eigen::Index>(i)],
                         .encoder_sign = 1};
            node_configs[i].node_id = static_cast<std::uint8_t>(i + 1);
            motor_node_init(&node_configs[i], &nodes[i]);
        }
    }

    static std::vector<std::string> with_defaults(std::vector<std::string> overrides) {
        overrides.insert(overrides.begin(), {"bus.pipeline=2", "bench.sync_Hz=100"});
        return overrides;
    }

    /// One SYNC period; the frames of the host arrive at its begin.
    void step() {
        check.step(from_nodes.frames.data(), from_nodes.count, output);
        PeriodFrames from_host;
        from_host.append(output.frames.data(), output.frame_count);
        PeriodFrames sent;
        constexpr int kTicks = 10;
        for (std::size_t i = 0; i < kJoints; ++i) {
            PeriodFrames inbox;
            deliver(static_cast<int>(i + 1), from_nodes, inbox);
            deliver(static_cast<int>(i + 1), from_host, inbox);
            for (int tick = 0; tick < kTicks; ++tick) {
                simulated_joint_advance(&joints[i], torque_Nm[i], 1000, &states[i]);
                motor_node_input_t input{};
                input.elapsed_us = 1000;
                input.position_inc = simulated_joint_position_inc(&joints[i], &states[i]);
                input.temperature_dC = 250;
                input.frames = inbox.frames.data();
                input.frame_count = tick == 0 ? inbox.count : 0;
                motor_node_output_t out;
                motor_node_step(&node_configs[i], &nodes[i], &input, &out);
                torque_Nm[i] = out.output_enabled ? out.torque_mNm / 1000.0 : 0.0;
                most_Nm = std::max(most_Nm, std::abs(torque_Nm[i]));
                if (out.reset_requested) {
                    motor_node_restart(&node_configs[i], &nodes[i]);
                }
                sent.append(out.frames, out.frame_count);
            }
            most_rad[i] = std::max(most_rad[i], std::abs(states[i].angle_rad));
        }
        from_nodes = sent;
        from_nodes.sort_by_identifier();
        ++periods;
    }

    /// To its end; false when that does not come.
    bool run() {
        while (!output.finished && periods < 2000) {
            step();
        }
        return output.finished;
    }

    RunConfig config;
    EncoderCheck check;
    std::array<simulated_joint_config_t, kJoints> joints{};
    std::array<simulated_joint_t, kJoints> states{};
    std::array<motor_node_config_t, kJoints> node_configs{};
    std::array<motor_node_t, kJoints> nodes{};
    std::array<double, kJoints> torque_Nm{};
    std::array<double, kJoints> most_rad{};
    double most_Nm = 0.0;
    PeriodFrames from_nodes{};
    HostCycleOutput output;
    int periods = 0;
};

void check_ends(Joints &rig, const std::string &cause) {
    REQUIRE(rig.run());
    CHECK(rig.check.fault().find(cause) != std::string::npos);
    INFO(rig.check.fault());
    CHECK(rig.check.fault().find('\n') == std::string::npos);
    for (std::size_t i = 0; i < kJoints; ++i) {
        CHECK(rig.torque_Nm[i] == 0.0);
        CHECK(rig.nodes[i].nmt == NMT_STOPPED);
    }
}

} // namespace

TEST_CASE("joints with sound encoders pass, each moved a little, and stand") {
    Joints rig;
    REQUIRE(rig.run());
    CHECK(rig.check.fault().empty());
    for (std::size_t i = 0; i < kJoints; ++i) {
        CHECK(rig.most_rad[i] >= 0.01);
        CHECK(rig.most_rad[i] < 0.1);
        CHECK(rig.states[i].speed_rad_s == 0.0);
        CHECK(rig.nodes[i].nmt == NMT_STOPPED);
    }
    CHECK(rig.most_Nm <= 2.0);
    CHECK(rig.check.to_json().find("\"moved_rad\": 0.01") != std::string::npos);
}

TEST_CASE("an encoder the wrong way round is named, and no other joint is pushed after it") {
    Joints rig;
    rig.joints[1].encoder_sign = -1;
    check_ends(rig, "encoder of joint 2 counts against the torque of its motor");
    CHECK(rig.most_rad[0] >= 0.01);
    CHECK(rig.most_rad[1] < 0.1);
    CHECK(rig.most_rad[2] == 0.0);
}

TEST_CASE("a joint that does not move is named") {
    Joints rig;
    rig.joints[2].coulomb_Nm = 10.0;
    check_ends(rig, "joint 3 did not move under 0.50 N m");
    CHECK(rig.most_Nm <= 2.0);
}

TEST_CASE("an arm away from home is not moved") {
    Joints rig;
    rig.joints[1].angle_rad += 0.4;
    check_ends(rig, "encoder of joint 2 reads");
    CHECK(rig.most_Nm == 0.0);
}

TEST_CASE("motion is bounded") {
    Joints rig({"bench.check_motion_max_rad=0.011"});
    rig.joints[0].inertia_kg_m2 = 0.005;
    check_ends(rig, "more than bench.check_motion_max_rad, 0.011");
}

TEST_CASE("a silent node ends the check") {
    Joints rig;
    while (rig.most_rad[0] < 0.005) {
        rig.step();
    }
    rig.from_nodes = {};
    for (int i = 0; i < 3; ++i) {
        rig.step();
        rig.from_nodes = {};
    }
    CHECK(rig.check.fault().find("sent no TPDO1 for 2 periods") != std::string::npos);
}

TEST_CASE("a stop on request is no fault") {
    Joints rig;
    while (rig.most_rad[0] < 0.005) {
        rig.step();
    }
    rig.check.request_stop();
    REQUIRE(rig.run());
    CHECK(rig.check.fault().empty());
    CHECK(rig.most_rad[1] == 0.0);
}

TEST_CASE("by the wall clock a TPDO1 may come a period late, but none twice") {
    Joints rig;
    while (rig.most_rad[0] < 0.005) {
        rig.step();
    }
    const PeriodFrames late = rig.from_nodes;
    rig.from_nodes = {};
    rig.step(); // none has come
    rig.from_nodes.append(late.frames.data(), late.count);
    rig.step(); // the late ones beside those of this period
    CHECK(rig.check.fault().empty());
    const PeriodFrames twice = rig.from_nodes;
    rig.from_nodes.append(twice.frames.data(), twice.count);
    rig.step();
    CHECK(rig.check.fault().find("sent 2 TPDO1 in one period") != std::string::npos);
}
