/**
 * The host's cycle against three real motor nodes on a bus that a test can tamper with. The arm
 * does not move: each joint stays where it starts, which is enough to boot, configure, enable and
 * stop.
 */
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "host/host_cycle.h"
#include "link/bus_closing.h"

extern "C" {
#include "node/motor_node.h"
}

namespace test {

/// The clock experiment as in sim_host/config/clock.toml, with overrides.
hpmc::RunConfig clock_config(const std::vector<std::string> &overrides = {});

can_frame_t frame(unsigned id, std::initializer_list<unsigned> bytes);

class NodeBench {
  public:
    explicit NodeBench(const hpmc::RunConfig &config = clock_config());

    /// Changes what the nodes sent before the host sees it.
    std::function<void(hpmc::PeriodFrames &)> tamper = [](hpmc::PeriodFrames &) {};
    /// Changes what the host sent before the nodes see it.
    std::function<void(hpmc::PeriodFrames &)> tamper_host = [](hpmc::PeriodFrames &) {};
    std::array<std::int32_t, hpmc::kJoints> displace_inc{}; ///< of each joint from home
    Eigen::Vector2d wrench_N = Eigen::Vector2d::Zero();
    std::optional<Eigen::Vector2d> target_m; ///< from outside, to act with the next step only

    void step();
    /// Steps until the host's phase is this one; false when it is not within 1000 periods.
    bool step_to(hpmc::RunPhase phase);

    hpmc::HostCycle cycle;
    std::array<motor_node_t, hpmc::kJoints> nodes{};
    hpmc::HostCycleOutput output; ///< of the last step
    std::int64_t period = 0;      ///< of the next step

    std::size_t sent(unsigned id) const; ///< frames with this identifier in the last output
    hpmc::RunPhase phase() const { return static_cast<hpmc::RunPhase>(cycle.state().phase); }

  private:
    std::array<motor_node_config_t, hpmc::kJoints> configs_{};
    std::array<std::int32_t, hpmc::kJoints> position_inc_{};
    hpmc::PeriodFrames from_nodes_{};
};

} // namespace test
