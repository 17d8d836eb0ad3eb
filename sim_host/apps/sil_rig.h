/**
 * The whole rig in one process: host layers, three firmware nodes and the ODE arm, frames over an
 * in-process bus, messages into a log file. The calls are those of hpmc_host, motor_node and
 * arm_sim, in the same order, so that ARM_STATE comes out byte for byte the same. Nodes are the
 * firmware linked in, or emulated boards at the other end of a line (rig_node.h).
 */
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "apps/rig_node.h"
#include "host/bus_account.h"
#include "host/host_cycle.h"
#include "host/telemetry.h"
#include "host/tick_clock.h"
#include "hpmc_lcm/arm_state_t.hpp"
#include "link/injected_sensors.h"
#include "link/lcm_link.h"
#include "link/target_inbox.h"
#include "plant/arm_plant.h"

namespace hpmc {

struct SilOptions {
    std::string log; ///< file of the LCM event log; none when empty
    LogLevel level = LogLevel::full;
    std::int64_t first_repetition = 0;
    std::int64_t repetitions = 0; ///< 0: as many as the configuration says
    std::string lcm_url{};        ///< publish there, and hear ARM_TARGET; nothing when empty
    std::string targets{};        ///< log whose targets from outside are to act again
};

using RigNodes = std::array<std::unique_ptr<RigNode>, kJoints>;

/// The firmware, three times in this process.
RigNodes native_nodes();
/// Flash images behind SLCAN lines, one address a node; connects to them. Throws LinkError.
RigNodes emulated_nodes(const std::vector<std::string> &addresses);

class SilRig {
  public:
    /// Native nodes. Throws LinkError when the log cannot be made.
    SilRig(const SilOptions &options, const RunConfig &config);
    /// mode: for RUN_INFO. Emulated nodes need injected sensors.
    SilRig(const SilOptions &options, const RunConfig &config, RigNodes nodes,
           const std::string &mode);

    std::int64_t first_period() const { return first_period_; }
    std::int64_t last_period() const { return last_period_; } ///< exclusive

    /// One SYNC period; to be called for first_period() and on, in order. False when the run has
    /// ended before its time: after a fault or on request.
    bool step(std::int64_t period);

    /// Sends what is still queued for those who look on.
    void flush() {
        if (live_) {
            live_->flush();
        }
    }

    void request_stop() { cycle_.request_stop(); }
    const std::string &fault() const { return cycle_.fault(); }
    const SchedulePoint &schedule_point() const { return cycle_.schedule_point(); }
    const BusAccount &account() const { return account_; }
    std::size_t frames_lost() const { return frames_lost_; }
    const HostCycle &host() const { return cycle_; }
    std::int64_t targets_dropped() const { return inbox_of_targets_.dropped(); }
    std::int64_t messages() const { return log_ ? log_->written() : 0; }

  private:
    /// The log, as far as its level goes, and whoever looks on.
    class Observers {
      public:
        explicit Observers(SilRig &rig) : rig_(rig) {}
        template <class Message> void publish(const char *channel, const Message &message) {
            if (rig_.log_ && (rig_.level_ == LogLevel::full || of_states(message))) {
                rig_.log_->publish(channel, message);
            }
            if (rig_.live_) {
                rig_.live_->publish(channel, message);
            }
        }

      private:
        template <class Message> static bool of_states(const Message &) {
            return !std::is_same_v<Message, hpmc_lcm::can_frames_t> &&
                   !std::is_same_v<Message, hpmc_lcm::node_status_t>;
        }
        static bool of_states(const hpmc_lcm::arm_target_t &message) {
            return message.target == kOutsideTarget;
        }
        SilRig &rig_;
    };

    template <class Message> void log(const char *channel, const Message &message) {
        if (log_ && level_ == LogLevel::full) {
            log_->publish(channel, message);
        }
    }
    void begin_repetition(std::int64_t repetition);
    void publish_arm_state(std::int64_t period, std::int64_t tick, const ArmPlantState &state);
    void publish_wrench(std::int64_t period, const ArmPlantState &state);
    void close_bus(std::int64_t period);
    void step_nodes(std::int64_t period, std::int64_t tick, const ArmPlantState &state);

    LogLevel level_;
    RunConfig config_;
    RunSchedule schedule_;
    std::int64_t first_period_;
    std::int64_t last_period_;
    TickClock clock_;
    HostCycle cycle_;
    ArmPlant plant_;
    InjectedSensors sensors_;
    Telemetry telemetry_;
    BusAccount account_;
    std::unique_ptr<LcmLogWriter> log_;
    std::unique_ptr<LcmSender> live_;
    TargetInbox inbox_of_targets_;
    RigNodes nodes_;
    std::array<PeriodFrames, kJoints> inbox_{};
    PeriodFrames sent_{};       ///< by the nodes in the present period
    PeriodFrames from_nodes_{}; ///< by the nodes in the period before
    HostCycleOutput output_;
    hpmc_lcm::arm_state_t arm_state_{};
    Eigen::Vector3d tau_Nm_ = Eigen::Vector3d::Zero();
    std::array<std::int32_t, kJoints> frames_sent_{};
    std::int64_t last_utime_;
    std::size_t frames_lost_ = 0;
};

} // namespace hpmc
