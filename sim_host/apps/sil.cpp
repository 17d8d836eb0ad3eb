// sil: the whole rig in one process: host layers, three firmware nodes and the ODE arm, frames over
// an in-process bus, messages into a log file. The calls are those of hpmc_host, motor_node and
// arm_sim, in the same order, so that ARM_STATE comes out byte for byte the same.

#include <memory>

#include "apps/common_options.h"
#include "hpmc_lcm/bus_closed_t.hpp"
#include "hpmc_lcm/joint_torque_t.hpp"
#include "host/bus_account.h"
#include "host/progress.h"
#include "host/tick_clock.h"
#include "link/injected_sensors.h"
#include "link/lcm_link.h"
#include "plant/arm_state_message.h"

extern "C" {
#include "node/motor_node.h"
#include "port/posix/encoder_model.h"
#include "port/posix/stop_signal.h"
}

using namespace hpmc;

namespace {

constexpr std::int16_t kAmbient_dC = 250;
constexpr std::array<const char *, kJoints> kTorqueChannels{"JOINT_TORQUE_1", "JOINT_TORQUE_2",
                                                            "JOINT_TORQUE_3"};

struct Options {
    ConfigOptions config;
    std::string log;
    LogLevel level = LogLevel::full;
    std::int64_t first_repetition = 0;
    std::int64_t repetitions = 0; ///< 0: as many as the configuration says
};

/// One firmware node and its link to the arm.
struct Node {
    motor_node_config_t config{};
    motor_node_t device{};
    motor_node_output_t output{};

    void step(const motor_node_input_t &input) {
        motor_node_step(&config, &device, &input, &output);
        if (output.reset_requested) {
            motor_node_init(&config, &device);
        }
    }
};

class SilRig {
  public:
    SilRig(const Options &options, const RunConfig &config)
        : options_(options), config_(config), schedule_(config), clock_{config.joint_ticks()},
          cycle_(config), plant_(config.plant), sensors_(config.joint.increments_per_revolution),
          telemetry_(config, "sil", options.level) {
        if (!options.log.empty()) {
            log_ = std::make_unique<LcmLogWriter>(options.log);
        }
        for (std::size_t joint = 0; joint < kJoints; ++joint) {
            const auto id = static_cast<std::uint8_t>(joint + 1);
            nodes_[joint].config.node_id = id;
            nodes_[joint].config.serial_number = id;
            nodes_[joint].config.referenced = true;
            motor_node_init(&nodes_[joint].config, &nodes_[joint].device);
        }
    }

    int run() {
        const std::int64_t per_repetition = schedule_.periods_per_repetition();
        const std::int64_t repetitions =
            options_.repetitions > 0 ? options_.repetitions : config_.experiment.repetitions;
        const std::int64_t first = options_.first_repetition * per_repetition;
        const std::int64_t last = first + repetitions * per_repetition;
        last_utime_ = first * kSyncPeriod_us;
        for (std::int64_t period = first; period < last; ++period) {
            if (stop_signal_raised()) {
                cycle_.request_stop();
            }
            step(period);
            ++periods_;
            say_progress(period, cycle_.schedule_point());
            if (output_.finished) {
                break;
            }
        }
        std::printf("STATS {\"frames\": %lld, \"frames_lost\": %zu, \"load_typical_percent\": %.2f, "
                    "\"messages\": %lld, \"periods\": %lld}\n",
                    static_cast<long long>(account_.frames()), frames_lost_,
                    account_.load_typical_percent(),
                    static_cast<long long>(log_ ? log_->written() : 0),
                    static_cast<long long>(periods_));
        if (!cycle_.fault().empty()) {
            std::fprintf(stderr, "sil: %s\n", cycle_.fault().c_str());
            return kExitRunEnded;
        }
        return stop_signal_raised() ? kExitRunEnded : 0;
    }

  private:
    template <class Message> void log(const char *channel, const Message &message) {
        if (log_ && options_.level == LogLevel::full) {
            log_->publish(channel, message);
        }
    }

    void publish_arm_state(std::int64_t period, std::int64_t tick, const ArmPlantState &state) {
        arm_state_.utime = clock_.utime(period, tick);
        arm_state_.seq = clock_.seq(period, tick);
        fill_arm_state(state, tau_Nm_, arm_state_);
        if (log_) {
            log_->publish("ARM_STATE", arm_state_);
        }
    }

    void publish_wrench(std::int64_t period, const ArmPlantState &state) {
        hpmc_lcm::hand_wrench_t message{};
        message.utime = clock_.utime(period, 0);
        message.seq = period;
        for (int i = 0; i < 2; ++i) {
            message.wrench_N[i] = state.wrench_N[i];
        }
        std::copy(frames_sent_.begin(), frames_sent_.end(), message.frames_sent);
        log("HAND_WRENCH", message);
        frames_sent_ = {};
    }

    void close_bus(std::int64_t period) {
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

    void step_nodes(std::int64_t period, std::int64_t tick, const ArmPlantState &state) {
        const std::int64_t utime = clock_.utime(period, tick);
        for (std::size_t joint = 0; joint < kJoints; ++joint) {
            const auto at = static_cast<Eigen::Index>(joint);
            Node &node = nodes_[joint];
            motor_node_input_t input{};
            input.elapsed_us = static_cast<std::uint32_t>(utime - last_utime_);
            input.position_inc = encoder_model_increments(
                state.q_rad[at],
                static_cast<std::uint32_t>(config_.joint.increments_per_revolution));
            input.temperature_dC = kAmbient_dC;
            input.frames = inbox_[joint].frames.data();
            input.frame_count = tick == 0 ? inbox_[joint].count : 0;
            node.step(input);
            sent_.append(node.output.frames, node.output.frame_count);
            frames_sent_[joint] += static_cast<std::int32_t>(node.output.frame_count);
            hpmc_lcm::joint_torque_t message{};
            message.utime = utime;
            message.seq = clock_.seq(period, tick);
            message.tau_Nm = node.output.torque_mNm / 1000.0;
            message.frames_sent = static_cast<std::int32_t>(node.output.frame_count);
            tau_Nm_[at] = message.tau_Nm;
            log(kTorqueChannels[joint], message);
        }
        last_utime_ = utime;
        if (config_.sensors == Sensors::injected) {
            tau_Nm_ = sensors_.torque_Nm(sent_);
        }
    }

    void step(std::int64_t period) {
        if (period % schedule_.periods_per_repetition() == 0) {
            plant_.reset(start_pose_rad(config_, period / schedule_.periods_per_repetition()));
            tau_Nm_.setZero();
            sensors_.reset();
        }
        ArmPlantState state = plant_.state();
        publish_wrench(period, state);
        publish_arm_state(period, 0, state);
        from_nodes_ = sent_;
        sent_.count = 0;
        from_nodes_.sort_by_identifier();
        cycle_.step({period, state.wrench_N, from_nodes_.frames.data(), from_nodes_.count}, output_);
        if (config_.sensors == Sensors::injected) {
            sensors_.inject(state.q_rad, period, from_nodes_);
        }
        account_.add(period, from_nodes_, output_);
        close_bus(period);
        if (log_) {
            telemetry_.publish(*log_, cycle_, from_nodes_, output_);
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
    }

    Options options_;
    RunConfig config_;
    RunSchedule schedule_;
    TickClock clock_;
    HostCycle cycle_;
    ArmPlant plant_;
    InjectedSensors sensors_;
    Telemetry telemetry_;
    BusAccount account_;
    std::unique_ptr<LcmLogWriter> log_;
    std::array<Node, kJoints> nodes_;
    std::array<PeriodFrames, kJoints> inbox_{};
    PeriodFrames sent_{};       ///< by the nodes in the present period
    PeriodFrames from_nodes_{}; ///< by the nodes in the period before
    HostCycleOutput output_;
    hpmc_lcm::arm_state_t arm_state_{};
    Eigen::Vector3d tau_Nm_ = Eigen::Vector3d::Zero();
    std::array<std::int32_t, kJoints> frames_sent_{};
    std::int64_t last_utime_ = 0;
    std::int64_t periods_ = 0;
    std::size_t frames_lost_ = 0;
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"The rig in one process."};
    Options options;
    options.config.add_to(app);
    app.add_option("--log", options.log, "LCM event log to write; none when left out");
    add_log_level(app, options.level);
    app.add_option("--first-repetition", options.first_repetition)
        ->check(CLI::Range(std::int64_t{0}, std::int64_t{100000}));
    app.add_option("--repetitions", options.repetitions)
        ->check(CLI::Range(std::int64_t{0}, std::int64_t{100000}));
    return run_app("sil", app, argc, argv, [&] {
        const RunConfig config = options.config.load();
        stop_signal_install(false);
        return SilRig(options, config).run();
    });
}
