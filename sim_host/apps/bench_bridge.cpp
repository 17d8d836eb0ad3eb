// bench_bridge: closes the loop between the simulated arm and nodes on a real bus. Each SYNC period
// the newest angles go to the nodes as RPDO4, which steps them, and the torques of their TPDO1 go
// to arm_sim. Boards speak CAN only: this is their place in the lockstep of arm_sim.

#include <algorithm>

#include "apps/common_options.h"
#include "host/progress.h"
#include "host/tick_clock.h"
#include "hpmc_lcm/arm_state_t.hpp"
#include "hpmc_lcm/bus_closed_t.hpp"
#include "hpmc_lcm/joint_torque_t.hpp"
#include "link/can_bus.h"
#include "link/injected_sensors.h"
#include "link/lcm_link.h"
#include "link/realtime.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

using namespace hpmc;

namespace {

constexpr std::uint16_t kNmt = 0x000;
constexpr std::uint16_t kSync = 0x080;
constexpr std::uint16_t kTpdo1 = 0x180;
constexpr std::uint16_t kSdoAnswer = 0x580;
constexpr std::uint16_t kSdoRequest = 0x600;
constexpr std::uint16_t kHeartbeat = 0x700;
constexpr std::uint8_t kNmtResetNode = 0x81;
constexpr int kSettle_ms = 2;     ///< in a period without SYNC: it may still be on its way
constexpr int kSilentPeriods = 2; ///< a node silent for so long is no longer waited for
constexpr std::array<const char *, kNodes> kTorqueChannels{"JOINT_TORQUE_1", "JOINT_TORQUE_2",
                                                           "JOINT_TORQUE_3"};

struct Options {
    ConfigOptions config;
    std::string can = "vcan0";
    std::string plant_url = kDefaultPlantUrl;
    int stall_timeout_ms = 10000;
    int reply_timeout_ms = 500;
};

/// What a node owes in this period.
struct Owed {
    bool tpdo1 = false;   ///< to SYNC
    bool answer = false;  ///< to an SDO request
    bool boot_up = false; ///< after a reset
};

class Bridge {
  public:
    Bridge(const Options &options, const RunConfig &config)
        : reply_timeout_ms_(options.reply_timeout_ms), config_(config),
          schedule_(config), clock_{config.joint_ticks()},
          sensors_(config.joint.increments_per_revolution),
          bus_(options.can, {{kNmt, 0x7FF},
                             {kSync, 0x7FF},
                             {kTpdo1, 0x780},
                             {kSdoAnswer, 0x780},
                             {kSdoRequest, 0x780},
                             {kHeartbeat, 0x780}}),
          arm_(options.plant_url, "ARM_STATE", options.stall_timeout_ms),
          closed_(options.plant_url, "BUS_CLOSED", options.stall_timeout_ms),
          sender_(options.plant_url) {}

    void run() {
        const std::int64_t periods =
            config_.experiment.repetitions * schedule_.periods_per_repetition();
        try {
            for (std::int64_t period = 0; period < periods; ++period) {
                step(period);
            }
        } catch (const StopRequested &) {
        }
        std::printf("STATS {\"frames_dropped\": %u, \"replies_missing\": %lld, "
                    "\"replies_late\": %lld}\n",
                    bus_.socket().dropped, static_cast<long long>(replies_missing_),
                    static_cast<long long>(replies_late_));
    }

  private:
    void step(std::int64_t period) {
        if (period % schedule_.periods_per_repetition() == 0) {
            sensors_.reset();
        }
        arm_.await(period, arm_state_);
        closed_.await(period, bus_closed_); // the host's frames are on the bus
        received_.count = 0;
        sync_seen_ = false;
        for (Owed &owed : owed_) {
            owed = {.tpdo1 = false, .answer = false, .boot_up = reset_};
        }
        reset_ = false;
        bus_.receive_available(received_);
        for (std::size_t i = 0; i < received_.count; ++i) {
            on_host_frame(received_.frames[i]);
            replies_late_ += node_of(received_.frames[i], kTpdo1) > 0 ? 1 : 0;
        }

        PeriodFrames frames;
        sensors_.inject({arm_state_.q_rad[0], arm_state_.q_rad[1], arm_state_.q_rad[2]}, period,
                        frames);
        bus_.send(frames.frames.data(), frames.count);
        await_replies();
        publish_torques(period);
    }

    /// 1..kNodes when the frame is of this function and of one of the nodes, else 0.
    static std::size_t node_of(const can_frame_t &frame, std::uint16_t function) {
        const std::size_t node = static_cast<std::size_t>(frame.id - function);
        return frame.id > function && node <= kNodes ? node : 0;
    }

    void on_host_frame(const can_frame_t &frame) {
        if (frame.id == kSync) {
            sync_seen_ = true;
            for (Owed &owed : owed_) {
                owed.tpdo1 = true;
            }
        } else if (frame.id == kNmt && frame.len == 2 && frame.data[0] == kNmtResetNode) {
            reset_ = true; // a node boots with the step after the one that it is reset in
        } else if (const std::size_t node = node_of(frame, kSdoRequest)) {
            owed_[node - 1].answer = true;
        }
    }

    void on_node_frame(const can_frame_t &frame) {
        if (const std::size_t node = node_of(frame, kTpdo1)) {
            owed_[node - 1].tpdo1 = false;
            periods_silent_[node - 1] = 0;
        } else if (const std::size_t server = node_of(frame, kSdoAnswer)) {
            owed_[server - 1].answer = false;
            periods_silent_[server - 1] = 0;
        } else if (const std::size_t booted = node_of(frame, kHeartbeat)) {
            owed_[booted - 1].boot_up = owed_[booted - 1].boot_up && frame.data[0] != 0;
            periods_silent_[booted - 1] = 0;
        }
    }

    bool owes(std::size_t i) const { return owed_[i].tpdo1 || owed_[i].answer || owed_[i].boot_up; }

    /// Nodes that fell silent are not waited for.
    bool complete() const {
        for (std::size_t i = 0; i < kNodes; ++i) {
            if (owes(i) && periods_silent_[i] < kSilentPeriods) {
                return false;
            }
        }
        return true;
    }

    void await_replies() {
        const std::int64_t limit_ns = monotonic_ns() + reply_timeout_ms_ * 1000000LL;
        bool waiting = true;
        while (waiting && !(sync_seen_ && complete()) && monotonic_ns() < limit_ns) {
            const std::size_t before = received_.count;
            waiting = bus_.receive_some(received_, complete() ? kSettle_ms : reply_timeout_ms_);
            for (std::size_t i = before; i < received_.count; ++i) {
                on_host_frame(received_.frames[i]);
                on_node_frame(received_.frames[i]);
            }
            if (stop_signal_raised()) {
                throw StopRequested{};
            }
        }
        for (std::size_t i = 0; i < kNodes; ++i) {
            replies_missing_ += owes(i) ? 1 : 0;
            periods_silent_[i] += owes(i) ? 1 : 0;
        }
    }

    void publish_torques(std::int64_t period) {
        const Eigen::Vector3d torque_Nm = sensors_.torque_Nm(received_);
        for (std::size_t i = 0; i < kNodes; ++i) {
            hpmc_lcm::joint_torque_t message{};
            message.utime = clock_.utime(period, 0);
            message.seq = clock_.seq(period, 0);
            message.tau_Nm = torque_Nm[static_cast<Eigen::Index>(i)];
            message.frames_sent = 0; // the host does not wait for counts here
            sender_.publish(kTorqueChannels[i], message);
        }
        sender_.flush();
    }

    static std::int64_t monotonic_ns() {
        timespec now{};
        clock_gettime(CLOCK_MONOTONIC, &now);
        return now.tv_sec * 1000000000LL + now.tv_nsec;
    }

    int reply_timeout_ms_;
    RunConfig config_;
    RunSchedule schedule_;
    TickClock clock_;
    InjectedSensors sensors_;
    CanBus bus_;
    LcmReceiver arm_;
    LcmReceiver closed_;
    LcmSender sender_;
    hpmc_lcm::arm_state_t arm_state_{};
    hpmc_lcm::bus_closed_t bus_closed_{};
    PeriodFrames received_{};
    bool sync_seen_ = false; ///< in this period
    bool reset_ = false;     ///< the nodes are reset in this period
    std::array<Owed, kNodes> owed_{};
    std::array<int, kNodes> periods_silent_{};
    std::int64_t replies_missing_ = 0;
    std::int64_t replies_late_ = 0;
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"Simulated arm to real nodes: RPDO4 out, TPDO1 in."};
    Options options;
    options.config.add_to(app);
    app.add_option("--can", options.can, "CAN interface");
    app.add_option("--plant-url", options.plant_url);
    app.add_option("--stall-timeout-ms", options.stall_timeout_ms)->check(CLI::Range(100, 600000));
    app.add_option("--reply-timeout-ms", options.reply_timeout_ms,
                   "longest wait for what the nodes owe in a period")
        ->check(CLI::Range(1, 10000));
    return run_app("bench_bridge", app, argc, argv, [&] {
        const RunConfig config = options.config.load();
        stop_signal_install(true);
        Bridge bridge(options, config);
        become_realtime();
        say_ready();
        bridge.run();
        return 0;
    });
}
