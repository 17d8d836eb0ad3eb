/**
 * Before the first motion of real joints: does each encoder read what the arm's posture says, and
 * does it count the way its motor turns? One joint at a time is pushed with a small torque (mode
 * 10, cyclic synchronous torque) until it has moved a little, then braked; the others are without
 * torque. One call to step() per SYNC period; it knows no clock.
 *
 * Ends with the nodes stopped, after a fault too: an angle further from home than
 * bench.check_tolerance_rad, a joint that moves against its torque, does not move, or moves too
 * far, and what the master watches.
 */
#pragma once

#include <array>
#include <string>

#include "host/host_cycle.h"

namespace hpmc {

class EncoderCheck {
  public:
    explicit EncoderCheck(const RunConfig &config);

    /// `frames`: what the nodes sent since the last call.
    void step(const can_frame_t *frames, std::size_t count, HostCycleOutput &output);

    void request_stop() { stop_requested_ = true; }
    /// Why the joints must not be moved; empty if they may.
    const std::string &fault() const { return fault_; }
    /// What each joint did, as the inside of a JSON object.
    std::string to_json() const;

  private:
    enum class Stage { bring_up, settle, push, brake, rest, stop };

    /// What showed the sign of an encoder.
    struct Finding {
        double moved_rad = 0.0;
        double torque_Nm = 0.0;
    };

    bool lasted(double seconds) const;
    void enter(Stage stage);
    void raise(const std::string &why);
    double angle_rad(std::size_t joint) const;
    double moved_rad(std::size_t joint) const { return angle_rad(joint) - start_rad_[joint]; }
    void check_posture();
    void push();
    void brake();
    void check_motion();
    std::string who_moved_instead() const;
    void advance();

    RunConfig config_;
    CanopenMaster master_;
    Eigen::Vector3d home_rad_;
    double period_s_;
    Stage stage_ = Stage::bring_up;
    std::int64_t periods_ = 0; ///< in this stage
    bool first_ = true;
    bool stop_requested_ = false;
    std::size_t joint_ = 0; ///< under test
    double torque_Nm_ = 0.0;
    std::array<double, kJoints> start_rad_{};
    double last_rad_ = 0.0;
    std::array<Finding, kJoints> findings_{};
    std::string fault_;
};

} // namespace hpmc
