/**
 * A motor node as the in-process rig sees it: native (the firmware linked in) or emulated (the
 * flash image, or whatever else speaks SLCAN, at the end of a line).
 *
 * A joint tick has two halves, so that nodes in other processes compute at the same time: begin all
 * nodes, then end all.
 */
#pragma once

#include <string>

#include "link/bus_closing.h"
#include "link/slcan_link.h"

extern "C" {
#include "node/motor_node.h"
}

namespace hpmc {

/// What a node gets in a joint tick.
struct RigNodeTick {
    std::uint32_t elapsed_us = 0;
    std::int32_t position_inc = 0; ///< for a node with an encoder of its own
    std::int16_t temperature_dC = 0;
    const can_frame_t *frames = nullptr; ///< in order; of an emulated node RPDO4 closes the tick
    std::size_t frame_count = 0;
};

class RigNode {
  public:
    virtual ~RigNode() = default;
    virtual void begin(const RigNodeTick &tick) = 0;
    /// Appends the frames that the node sent in the tick that began last.
    virtual void end(PeriodFrames &sent) = 0;
    /// Computed in the last tick.
    virtual double torque_Nm() const = 0;
};

class NativeNode : public RigNode {
  public:
    explicit NativeNode(std::uint8_t node_id);
    void begin(const RigNodeTick &tick) override;
    void end(PeriodFrames &sent) override;
    double torque_Nm() const override;

  private:
    motor_node_config_t config_{};
    motor_node_t device_{};
    motor_node_output_t output_{};
};

class EmulatedNode : public RigNode {
  public:
    /// Connects to the node, opens its channel, and takes it into the stepped time base with
    /// injected sensors. Throws LinkError when it does not answer.
    EmulatedNode(std::uint8_t node_id, const std::string &address);
    EmulatedNode(std::uint8_t node_id, int fd); ///< over a descriptor that it takes over
    void begin(const RigNodeTick &tick) override;
    void end(PeriodFrames &sent) override;
    double torque_Nm() const override { return torque_Nm_; } ///< of the newest TPDO1

  private:
    void set_up();
    void write_object(std::uint16_t index, std::uint8_t value);

    std::uint8_t node_id_;
    std::string name_;
    SlcanLink link_;
    double torque_Nm_ = 0.0;
};

} // namespace hpmc
