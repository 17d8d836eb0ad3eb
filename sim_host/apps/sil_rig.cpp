#include "apps/sil_rig.h"

#include <utility>

#include "hpmc_lcm/bus_closed_t.hpp"
#include "hpmc_lcm/joint_torque_t.hpp"
#include "plant/arm_state_message.h"
#include "port/posix/encoder_model.h"

namespace hpmc {
namespace {

constexpr std::int16_t kAmbient_dC = 250;
constexpr std::int64_t kPeriodsPerFlush = 4; ///< live: one system call for so many periods
constexpr std::array<const char *, kJoints> kTorqueChannels{"JOINT_TORQUE_1", "JOINT_TORQUE_2",
                                                            "JOINT_TORQUE_3"};

} // namespace

RigNodes native_nodes() {
    RigNodes nodes;
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        nodes[joint] = std::make_unique<NativeNode>(static_cast<std::uint8_t>(joint + 1));
    }
    return nodes;
}

RigNodes emulated_nodes(const std::vector<std::string> &addresses) {
    RigNodes nodes;
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        nodes[joint] = std::make_unique<EmulatedNode>(static_cast<std::uint8_t>(joint + 1),
                                                      addresses.at(joint));
    }
    return nodes;
}

SilRig::SilRig(const SilOptions &options, const RunConfig &config)
    : SilRig(options, config, native_nodes(), "sil") {}

SilRig::SilRig(const SilOptions &options, const RunConfig &config, RigNodes nodes,
               const std::string &mode)
    : level_(options.level), config_(config), schedule_(config),
      first_period_(options.first_repetition * schedule_.periods_per_repetition()),
      last_period_(first_period_ +
                   (options.repetitions > 0 ? options.repetitions : config.experiment.repetitions) *
                       schedule_.periods_per_repetition()),
      clock_{config.joint_ticks()}, cycle_(config), plant_(config.plant),
      sensors_(config.joint.increments_per_revolution),
      telemetry_(config, mode, options.lcm_url.empty() ? options.level : LogLevel::full),
      nodes_(std::move(nodes)), last_utime_(clock_.utime(first_period_, 0)) {
    if (!options.log.empty()) {
        log_ = std::make_unique<LcmLogWriter>(options.log);
    }
    if (!options.targets.empty()) {
        inbox_of_targets_.load(options.targets);
    }
    if (!options.lcm_url.empty()) {
        live_ = std::make_unique<LcmSender>(options.lcm_url);
        inbox_of_targets_.listen(options.lcm_url);
    }
}

void SilRig::begin_repetition(std::int64_t repetition) {
    plant_.reset(start_pose_rad(config_, repetition));
    tau_Nm_.setZero();
    sensors_.reset();
}

void SilRig::publish_arm_state(std::int64_t period, std::int64_t tick, const ArmPlantState &state) {
    arm_state_.utime = clock_.utime(period, tick);
    arm_state_.seq = clock_.seq(period, tick);
    fill_arm_state(state, tau_Nm_, arm_state_);
    Observers(*this).publish("ARM_STATE", arm_state_);
}

void SilRig::publish_wrench(std::int64_t period, const ArmPlantState &state) {
    hpmc_lcm::hand_wrench_t message{};
    message.utime = clock_.utime(period, 0);
    message.seq = period;
    fill_hand_wrench(state, frames_sent_, message);
    log("HAND_WRENCH", message);
    frames_sent_ = {};
}

void SilRig::close_bus(std::int64_t period) {
    hpmc_lcm::bus_closed_t message{};
    message.utime = clock_.utime(period, 0);
    message.seq = period;
    PeriodFrames from_host;
    from_host.append(output_.frames.data(), output_.frame_count);
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        inbox_[joint].count = 0;
        deliver(static_cast<int>(joint + 1), from_nodes_, inbox_[joint]);
        deliver(static_cast<int>(joint + 1), from_host, inbox_[joint]);
        message.node_frames[joint] = static_cast<std::int32_t>(inbox_[joint].count);
    }
    log("BUS_CLOSED", message);
}

void SilRig::step_nodes(std::int64_t period, std::int64_t tick, const ArmPlantState &state) {
    const std::int64_t utime = clock_.utime(period, tick);
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const auto at = static_cast<Eigen::Index>(joint);
        nodes_[joint]->begin(
            {static_cast<std::uint32_t>(utime - last_utime_),
             encoder_model_increments(
                 state.q_rad[at],
                 static_cast<std::uint32_t>(config_.joint.increments_per_revolution)),
             kAmbient_dC, inbox_[joint].frames.data(), tick == 0 ? inbox_[joint].count : 0});
    }
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const std::size_t sent_before = sent_.count + sent_.dropped;
        nodes_[joint]->end(sent_);
        const auto sent = static_cast<std::int32_t>(sent_.count + sent_.dropped - sent_before);
        frames_sent_[joint] += sent;
        hpmc_lcm::joint_torque_t message{};
        message.utime = utime;
        message.seq = clock_.seq(period, tick);
        message.tau_Nm = nodes_[joint]->torque_Nm();
        message.frames_sent = sent;
        tau_Nm_[static_cast<Eigen::Index>(joint)] = message.tau_Nm;
        log(kTorqueChannels[joint], message);
    }
    last_utime_ = utime;
    if (config_.sensors == Sensors::injected) {
        tau_Nm_ = sensors_.torque_Nm(sent_);
    }
}

bool SilRig::step(std::int64_t period) {
    if (period % schedule_.periods_per_repetition() == 0) {
        begin_repetition(period / schedule_.periods_per_repetition());
    }
    ArmPlantState state = plant_.state();
    publish_wrench(period, state);
    publish_arm_state(period, 0, state);
    from_nodes_ = sent_;
    sent_.count = 0;
    from_nodes_.sort_by_identifier();
    cycle_.step({period, state.wrench_N, from_nodes_.frames.data(), from_nodes_.count,
                 inbox_of_targets_.take(period)},
                output_);
    if (config_.sensors == Sensors::injected) {
        sensors_.inject(state.q_rad, period, from_nodes_);
    }
    account_.add(period, from_nodes_, output_);
    close_bus(period);
    if (log_ || live_) {
        Observers observers(*this);
        telemetry_.publish(observers, cycle_, from_nodes_, output_);
    }
    if (live_ && period % kPeriodsPerFlush == 0) {
        live_->flush();
    }
    for (std::int64_t tick = 0; tick < clock_.joint_ticks; ++tick) {
        if (tick > 0) {
            state = plant_.state();
            publish_arm_state(period, tick, state);
        }
        step_nodes(period, tick, state);
        plant_.advance(tau_Nm_, clock_.joint_period_s());
    }
    frames_lost_ += sent_.dropped;
    sent_.dropped = 0;
    return !output_.finished;
}

} // namespace hpmc
