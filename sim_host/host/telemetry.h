/**
 * What the host publishes of each SYNC period: HPMC_STATE, CAN_FRAMES, NODE_STATUS_n, ARM_TARGET
 * and RUN_INFO, to any sink with publish(channel, message).
 */
#pragma once

#include <string>

#include "host/host_cycle.h"
#include "hpmc_lcm/arm_target_t.hpp"
#include "hpmc_lcm/can_frames_t.hpp"
#include "hpmc_lcm/run_info_t.hpp"
#include "link/bus_closing.h"
#include "link/target_inbox.h"

namespace hpmc {

/// full: every channel; states: ARM_STATE, HPMC_STATE, RUN_INFO and targets from outside only.
enum class LogLevel { full, states };

/// RUN_INFO of this build and configuration.
hpmc_lcm::run_info_t make_run_info(const RunConfig &config, const std::string &mode);

class Telemetry {
  public:
    Telemetry(const RunConfig &config, const std::string &mode, LogLevel level);

    /// `from_nodes`: what the nodes sent in the period before; `from_host`: what the host sent now.
    template <class Sink>
    void publish(Sink &sink, HostCycle &cycle, const PeriodFrames &from_nodes,
                 const HostCycleOutput &from_host) {
        const hpmc_lcm::hpmc_state_t &state = cycle.state();
        if (run_info_due(state.utime)) {
            sink.publish("RUN_INFO", run_info_);
        }
        if (level_ == LogLevel::full) {
            if (target_changed(cycle)) {
                sink.publish("ARM_TARGET", arm_target_);
            }
            collect_frames(state, from_nodes, from_host);
            sink.publish("CAN_FRAMES", can_frames_);
            for (std::size_t joint = 0; joint < kJoints; ++joint) {
                if (cycle.node_status(joint, node_status_)) {
                    sink.publish(kStatusChannels[joint], node_status_);
                }
            }
        }
        if (outside_target_began(cycle)) {
            sink.publish("ARM_TARGET", arm_target_);
        }
        sink.publish("HPMC_STATE", state);
    }

  private:
    static constexpr std::array<const char *, kJoints> kStatusChannels{
        "NODE_STATUS_1", "NODE_STATUS_2", "NODE_STATUS_3"};

    bool run_info_due(std::int64_t utime);
    bool target_changed(const HostCycle &cycle);
    bool outside_target_began(const HostCycle &cycle);
    void collect_frames(const hpmc_lcm::hpmc_state_t &state, const PeriodFrames &from_nodes,
                        const HostCycleOutput &from_host);

    LogLevel level_;
    bool run_info_sent_ = false;
    hpmc_lcm::run_info_t run_info_;
    hpmc_lcm::arm_target_t arm_target_{};
    hpmc_lcm::can_frames_t can_frames_{};
    hpmc_lcm::node_status_t node_status_{};
};

} // namespace hpmc
