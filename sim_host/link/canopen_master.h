/**
 * The CANopen master part of the host: brings the motor nodes up, hands them their cyclic commands,
 * watches them, and takes them down. One call to receive() and one to compose() per SYNC period.
 *
 * Sources: CiA 301 (NMT, SDO, SYNC, EMCY, heartbeat), CiA 402-2 (drive state machine). Frames and
 * objects: docs/protocol.md. It knows no clock: every wait counts SYNC periods. At most one acyclic
 * frame goes out per period; a quick stop takes the place of the cyclic commands of its period, so
 * that it fits as well.
 */
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "canopen/can_frame.h"

namespace hpmc {

constexpr std::size_t kJoints = 3;

/// One object to be written over SDO before a node is started.
struct SdoWrite {
    std::uint16_t index;
    std::uint8_t subindex;
    std::uint8_t bytes; ///< 1, 2 or 4
    std::uint32_t value;
};

struct CanopenMasterConfig {
    std::array<std::vector<SdoWrite>, kJoints> configuration;
    std::uint32_t heartbeat_periods = 100; ///< host heartbeat, in SYNC periods
    std::int8_t mode = -1;                 ///< 6060h
    std::uint32_t stop_periods = 200;      ///< longest wait for the ramp of a quick stop
    bool sync_first = false;               ///< SYNC before the other frames of its period
    bool wall_clock =
        false; ///< a TPDO1 may come a period late: two are no fault where two are owed
};

/// Cyclic command of one joint: RPDO1.
struct JointCommand {
    std::int32_t position_inc = 0;    ///< 607Ah
    std::int16_t torque_mNm = 0;      ///< 6071h
    std::uint16_t torque_max_mNm = 0; ///< 6072h, 0..32767
};

/// What the master knows of one node.
struct NodeView {
    bool booted = false;
    std::uint8_t nmt_state = 0; ///< of the last heartbeat
    std::uint16_t statusword = 0;
    std::int32_t position_inc = 0;
    std::int16_t torque_mNm = 0;
    std::int8_t mode_display = 0;
    std::uint16_t limit_reasons = 0;
    std::uint16_t missed_sync = 0;
    std::int16_t temperature_dC = 0;
    std::uint16_t emcy_code = 0; ///< last error, 0 = none
    std::uint8_t error_register = 0;
    std::uint32_t emcy_count = 0;
    std::uint32_t tpdo1_in_period = 0; ///< TPDO1 received in the last receive()
    std::uint32_t periods_without_tpdo1 = 0;
    std::uint32_t owed_tpdo1 = 0; ///< SYNCs not yet answered, 0..2
};

/// RPDO2 with the command "quick stop" for each node.
std::array<can_frame_t, kJoints> quick_stop_frames();

enum class MasterStage { reset, boot, configure, start, enable, enabled, stopping, stopped };

class CanopenMaster {
  public:
    static constexpr std::size_t kFramesMax = 8;

    explicit CanopenMaster(CanopenMasterConfig config);

    /// Begins anew: all nodes are reset, booted, configured, started and enabled.
    void restart();

    /// Takes in what the nodes sent since the last call. Returns what went wrong, empty if nothing.
    const std::string &receive(const can_frame_t *frames, std::size_t count);

    /// Makes the frames of this period; returns their number. `commands` go out from stage `enable`
    /// on.
    std::size_t compose(const std::array<JointCommand, kJoints> &commands,
                        std::array<can_frame_t, kFramesMax> &frames);

    /// Quick stop of all nodes in the next compose(), then disabled, then NMT stopped.
    void stop();

    MasterStage stage() const { return stage_; }
    /// The nodes are off and the command NMT stop is among the frames of the last compose().
    bool stopped() const { return stage_ == MasterStage::stopped && periods_in_stage_ > 0; }
    const NodeView &node(std::size_t joint) const { return nodes_[joint]; }
    /// True when an emergency or a change of NMT state came with the last receive().
    bool news(std::size_t joint) const { return news_[joint]; }
    bool all_enabled() const;

  private:
    using Frames = std::array<can_frame_t, kFramesMax>;

    void on_sdo(std::size_t joint, const can_frame_t &frame);
    void on_node_frame(std::size_t joint, const can_frame_t &frame);
    void watch();
    void fail(std::size_t joint, const std::string &what);

    bool compose_configuration(Frames &frames, std::size_t &count);
    bool compose_enabling(Frames &frames, std::size_t &count);
    void compose_stopping(Frames &frames, std::size_t &count);
    void compose_sync(Frames &frames, std::size_t &count);
    void compose_cyclic(const std::array<JointCommand, kJoints> &commands, Frames &frames,
                        std::size_t &count);

    CanopenMasterConfig config_;
    MasterStage stage_ = MasterStage::reset;
    std::uint32_t periods_in_stage_ = 0;
    std::uint32_t periods_to_heartbeat_ = 0;
    std::uint8_t sync_counter_ = 0;
    std::size_t next_joint_ = 0; ///< whose turn it is for the acyclic frame
    std::array<NodeView, kJoints> nodes_;
    std::array<bool, kJoints> news_{};
    std::array<std::size_t, kJoints> configured_{};          ///< objects written so far
    std::array<std::uint32_t, kJoints> periods_to_answer_{}; ///< 0: no request under way
    std::array<std::uint16_t, kJoints> controlword_{};
    std::array<std::uint32_t, kJoints> periods_since_controlword_{};
    std::string fault_;

    void enter(MasterStage stage);
};

} // namespace hpmc
