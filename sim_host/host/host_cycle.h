/**
 * One cycle of the host, once per SYNC period: what the nodes sent comes in, the four layers of
 * H-PMC run, what goes to the nodes comes out. The same object runs in hpmc_host and in sil; it
 * knows no socket and no clock.
 *
 * A fault (docs/protocol.md, the host's own table) makes the same call answer with a quick stop to
 * all nodes; the cycle then goes on until the nodes are stopped, and fault() says why.
 */
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/run_config.h"
#include "host/run_schedule.h"
#include "hpmc_lcm/hpmc_state_t.hpp"
#include "hpmc_lcm/node_status_t.hpp"
#include "link/canopen_master.h"

namespace hpmc {

struct HostCycleInput {
    std::int64_t period;       ///< counted from the begin of repetition 0
    Eigen::Vector2d wrench_N;  ///< force of the hand on its environment
    const can_frame_t *frames; ///< what the nodes sent in the period before, by identifier
    std::size_t frame_count;
    /// Target of the hand from outside the schedule, to act with this period.
    std::optional<Eigen::Vector2d> target_m = std::nullopt;
};

struct HostCycleOutput {
    std::array<can_frame_t, CanopenMaster::kFramesMax> frames; ///< to send, in this order
    std::size_t frame_count = 0;
    bool finished = false; ///< the nodes are stopped after a fault or on request
};

/// What a run is in, for HPMC_STATE.phase.
enum class RunPhase { boot, configure, enable, approach, reaches, stop };

class HostCycle {
  public:
    explicit HostCycle(const RunConfig &config, TimeBase time_base = TimeBase::stepped);

    void step(const HostCycleInput &input, HostCycleOutput &output);

    /// Quick stop with the next step, as at the end of a run.
    void request_stop() { stop_requested_ = true; }

    /// Why the run ended early; empty if it did not.
    const std::string &fault() const { return fault_; }

    const SchedulePoint &schedule_point() const { return point_; }
    /// A target from outside acts since this very period; state().x_t_m is where it was put.
    bool outside_target_began() const { return outside_began_; }
    /// Targets from outside that acted so far, and those refused: outside the reaches, or no
    /// finite numbers.
    std::int64_t outside_targets() const { return outside_count_; }
    std::int64_t outside_targets_refused() const { return outside_refused_; }
    bool operating() const { return master_.stage() == MasterStage::enabled; }

    /// Every layer's input and output of the last step.
    const hpmc_lcm::hpmc_state_t &state() const { return state_; }

    /// True when NODE_STATUS of a joint is due after the last step; fills it in.
    bool node_status(std::size_t joint, hpmc_lcm::node_status_t &status);

  private:
    using Commands = std::array<JointCommand, kJoints>;

    void begin_repetition();
    void raise(const std::string &why);
    void choose_target(const std::optional<Eigen::Vector2d> &outside_m);
    Eigen::Vector2d reachable(const Eigen::Vector2d &x_m) const;
    void read_joints();
    Eigen::Vector3d approach(const Eigen::Vector3d &q_d_rad, double &torque_fraction);
    Commands command(const Eigen::Vector3d &q_d_rad, const HpmcOutput &out, double torque_fraction);
    Commands delayed(const Commands &commands);
    void fill_state(const HostCycleInput &input, const HpmcOutput &out,
                    const Eigen::Vector3d &q_d_rad);
    RunPhase phase() const;

    RunConfig config_;
    RunSchedule schedule_;
    CanopenMaster master_;
    HpmcController controller_;
    PlanarArm arm_;
    double increments_per_rad_;

    SchedulePoint point_{};
    Eigen::Vector2d x_t_m_ =
        Eigen::Vector2d::Zero();               ///< the schedule's target, or that from outside
    std::optional<Eigen::Vector2d> outside_m_; ///< in force until the next reach
    bool outside_began_ = false;
    std::int64_t outside_count_ = 0;
    std::int64_t outside_refused_ = 0;
    Eigen::Vector3d q_rad_ = Eigen::Vector3d::Zero();
    Eigen::Vector3d q_start_rad_ = Eigen::Vector3d::Zero(); ///< where the approach began
    Eigen::Vector3d q_blend_rad_ = Eigen::Vector3d::Zero(); ///< last desired angles of the approach
    std::int64_t periods_enabled_ = 0;
    std::vector<Commands> delay_line_; ///< commands on their way, oldest at delay_next_
    std::size_t delay_next_ = 0;
    bool stop_requested_ = false;
    bool stopping_ = false;
    std::string fault_;
    hpmc_lcm::hpmc_state_t state_{};
    std::array<std::int64_t, kJoints> status_seq_{};
};

} // namespace hpmc
