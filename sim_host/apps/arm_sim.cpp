// arm_sim: the ODE arm as a process; owns simulated time. Publishes HAND_WRENCH and ARM_STATE,
// waits for the torques of all nodes, advances.

#include "apps/common_options.h"
#include "host/progress.h"
#include "host/tick_clock.h"
#include "hpmc_lcm/joint_torque_t.hpp"
#include "link/can_bus.h"
#include "link/injected_sensors.h"
#include "link/lcm_link.h"
#include "link/pacer.h"
#include "link/realtime.h"
#include "plant/arm_state_message.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

using namespace hpmc;

namespace {

struct Options {
    ConfigOptions config;
    std::string can = "vcan0";
    std::string plant_url = kDefaultPlantUrl;
    bool realtime = false;
    bool bridged = false;
    int stall_timeout_ms = 10000;
};

class ArmProcess {
  public:
    ArmProcess(const Options &options, const RunConfig &config)
        : config_(config), schedule_(config), clock_{config.joint_ticks()}, plant_(config.plant),
          sensors_(config.joint.increments_per_revolution), sender_(options.plant_url),
          realtime_(options.realtime), pacer_(kSyncPeriod_us * 1000, Pacer::WhenLate::catch_up),
          torque_{LcmReceiver(options.plant_url, "JOINT_TORQUE_1", options.stall_timeout_ms),
                  LcmReceiver(options.plant_url, "JOINT_TORQUE_2", options.stall_timeout_ms),
                  LcmReceiver(options.plant_url, "JOINT_TORQUE_3", options.stall_timeout_ms)} {
        if (config.sensors == Sensors::injected && !options.bridged) {
            // TPDO1 of all nodes.
            bus_ = std::make_unique<CanBus>(options.can,
                                            std::vector<can_socket_filter_t>{{0x180, 0x780}});
        }
    }

    void run() {
        const std::int64_t periods =
            config_.experiment.repetitions * schedule_.periods_per_repetition();
        try {
            for (std::int64_t period = 0; period < periods; ++period) {
                if (realtime_) {
                    pacer_.wait();
                }
                step(period);
            }
        } catch (const StopRequested &) {
        }
        std::printf("STATS {\"overruns\": %lld, \"lateness_max_us\": %lld}\n",
                    static_cast<long long>(pacer_.overruns()),
                    static_cast<long long>(pacer_.lateness_max_us()));
    }

  private:
    void publish_arm_state(std::int64_t period, std::int64_t tick, const ArmPlantState &state) {
        arm_state_.utime = clock_.utime(period, tick);
        arm_state_.seq = clock_.seq(period, tick);
        fill_arm_state(state, tau_Nm_, arm_state_);
        sender_.publish("ARM_STATE", arm_state_);
    }

    void publish_wrench(std::int64_t period, const ArmPlantState &state) {
        hpmc_lcm::hand_wrench_t message{};
        message.utime = clock_.utime(period, 0);
        message.seq = period;
        fill_hand_wrench(state, frames_sent_, message);
        sender_.publish("HAND_WRENCH", message);
        frames_sent_ = {};
    }

    void inject(std::int64_t period, const ArmPlantState &state) {
        if (bus_) {
            PeriodFrames frames;
            sensors_.inject(state.q_rad, period, frames);
            bus_->send(frames.frames.data(), frames.count);
        }
    }

    void await_torques(std::int64_t seq) {
        // The last node as a rule answers last: waiting for it first saves wake-ups.
        for (std::size_t joint = kNodes; joint-- > 0;) {
            hpmc_lcm::joint_torque_t message{};
            torque_[joint].await(seq, message);
            tau_Nm_[static_cast<Eigen::Index>(joint)] = message.tau_Nm;
            frames_sent_[joint] += message.frames_sent;
        }
        if (bus_) {
            PeriodFrames frames;
            bus_->receive_available(frames);
            tau_Nm_ = sensors_.torque_Nm(frames);
        }
    }

    void step(std::int64_t period) {
        if (period % schedule_.periods_per_repetition() == 0) {
            plant_.reset(start_pose_rad(config_, period / schedule_.periods_per_repetition()));
            tau_Nm_.setZero();
            sensors_.reset();
        }
        for (std::int64_t tick = 0; tick < clock_.joint_ticks; ++tick) {
            const ArmPlantState state = plant_.state();
            if (tick == 0) {
                inject(period, state);
                publish_wrench(period, state);
            }
            publish_arm_state(period, tick, state);
            sender_.flush();
            await_torques(clock_.seq(period, tick));
            plant_.advance(tau_Nm_, clock_.joint_period_s());
        }
    }

    RunConfig config_;
    RunSchedule schedule_;
    TickClock clock_;
    ArmPlant plant_;
    InjectedSensors sensors_;
    LcmSender sender_;
    bool realtime_;
    Pacer pacer_;
    std::array<LcmReceiver, kNodes> torque_;
    std::unique_ptr<CanBus> bus_;
    hpmc_lcm::arm_state_t arm_state_{};
    Eigen::Vector3d tau_Nm_ = Eigen::Vector3d::Zero();
    std::array<std::int32_t, kNodes> frames_sent_{};
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"The arm simulated in ODE."};
    Options options;
    options.config.add_to(app);
    app.add_option("--can", options.can, "CAN interface, used with injected sensors");
    app.add_option("--plant-url", options.plant_url);
    app.add_flag("--realtime", options.realtime, "hold simulated time back to the wall clock");
    app.add_flag("--bridged", options.bridged,
                 "bench_bridge injects the sensors and brings the torques");
    app.add_option("--stall-timeout-ms", options.stall_timeout_ms)->check(CLI::Range(100, 600000));
    return run_app("arm_sim", app, argc, argv, [&] {
        const RunConfig config = options.config.load();
        stop_signal_install(true);
        if (options.bridged) {
            become_realtime();
        }
        ArmProcess(options, config).run();
        return 0;
    });
}
