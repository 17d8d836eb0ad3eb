#include "node_bench.h"

#include <algorithm>

#include "port/posix/encoder_model.h"

using namespace hpmc;

namespace test {

RunConfig clock_config(const std::vector<std::string> &overrides) {
    return load_run_config({CLOCK_TOML}, overrides);
}

can_frame_t frame(unsigned id, std::initializer_list<unsigned> bytes) {
    can_frame_t result{};
    result.id = static_cast<std::uint16_t>(id);
    result.len = static_cast<std::uint8_t>(bytes.size());
    std::transform(bytes.begin(), bytes.end(), result.data,
                   [](unsigned byte) { return static_cast<std::uint8_t>(byte); });
    return result;
}

NodeBench::NodeBench(const RunConfig &config) : cycle(config) {
    const Eigen::Vector3d q_rad = start_pose_rad(config, 0);
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const auto id = static_cast<std::uint8_t>(joint + 1);
        configs_[joint].node_id = id;
        configs_[joint].serial_number = id;
        configs_[joint].referenced = true;
        motor_node_init(&configs_[joint], &nodes[joint]);
        position_inc_[joint] = encoder_model_increments(
            q_rad[static_cast<Eigen::Index>(joint)],
            static_cast<std::uint32_t>(config.joint.increments_per_revolution));
    }
}

void NodeBench::step() {
    PeriodFrames from_host;
    tamper(from_nodes_);
    cycle.step({period, wrench_N, from_nodes_.frames.data(), from_nodes_.count, target_m}, output);
    target_m.reset();
    from_host.append(output.frames.data(), output.frame_count);
    tamper_host(from_host);
    PeriodFrames sent_now;
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        PeriodFrames inbox;
        deliver(static_cast<int>(joint + 1), from_nodes_, inbox);
        deliver(static_cast<int>(joint + 1), from_host, inbox);
        motor_node_input_t input{};
        input.elapsed_us = period == 0 ? 0 : 1000;
        input.position_inc = position_inc_[joint] + displace_inc[joint];
        input.temperature_dC = 250;
        input.frames = inbox.frames.data();
        input.frame_count = inbox.count;
        motor_node_output_t out;
        motor_node_step(&configs_[joint], &nodes[joint], &input, &out);
        if (out.reset_requested) {
            motor_node_init(&configs_[joint], &nodes[joint]);
        }
        sent_now.append(out.frames, out.frame_count);
    }
    from_nodes_ = sent_now;
    from_nodes_.sort_by_identifier();
    ++period;
}

bool NodeBench::step_to(RunPhase wanted) {
    constexpr int kPeriodsMax = 1000;
    for (int i = 0; i < kPeriodsMax; ++i) {
        step();
        if (phase() == wanted) {
            return true;
        }
    }
    return false;
}

std::size_t NodeBench::sent(unsigned id) const {
    return static_cast<std::size_t>(
        std::count_if(output.frames.begin(),
                      output.frames.begin() + static_cast<std::ptrdiff_t>(output.frame_count),
                      [id](const can_frame_t &f) { return f.id == id; }));
}

} // namespace test
