#include "host/node_configuration.h"

#include <cmath>

#include "link/motor_node_od.h"

namespace hpmc {
namespace {

constexpr std::uint32_t kHostId = 127;
constexpr std::uint32_t kSyncCounterMax = 240;
constexpr double kEnablingWindow_rad = 0.05; ///< 6065h: how far Q_d may be from the measured angle

std::uint32_t scaled(double value, double per_unit) {
    return static_cast<std::uint32_t>(std::lround(value * per_unit));
}

std::uint32_t unsigned_ms(std::int64_t value) {
    return static_cast<std::uint32_t>(value);
}

SdoWrite write(const motor_node_od::Entry &object, std::uint32_t value) {
    return {object.index, object.subindex,
            static_cast<std::uint8_t>(motor_node_od::size_bytes(object.type)), value};
}

/// 1016h: who is listened for, and how long a silence may last.
std::uint32_t heartbeat_consumer(std::uint32_t node_id, const RunConfig &config) {
    return node_id << 16U | unsigned_ms(config.bus.heartbeat_timeout_ms);
}

std::vector<SdoWrite> one_node(const RunConfig &config, TimeBase time_base, std::uint32_t node_id) {
    using namespace motor_node_od;
    const JointConfig &joint = config.joint;
    const double torque_limit_Nm =
        config.hpmc.joint_coordination.torque_limit_Nm[static_cast<Eigen::Index>(node_id - 1)];
    const std::int64_t period_us = sync_period_us(config, time_base);
    const std::uint32_t peer_a = node_id == 1 ? 2 : 1;
    const std::uint32_t peer_b = node_id == 3 ? 2 : 3;
    return {
        write(kProducerHeartbeatTime, unsigned_ms(config.bus.heartbeat_ms)),
        write(kConsumerHeartbeatTimeConsumerHeartbeatTime1, heartbeat_consumer(kHostId, config)),
        write(kConsumerHeartbeatTimeConsumerHeartbeatTime2, heartbeat_consumer(peer_a, config)),
        write(kConsumerHeartbeatTimeConsumerHeartbeatTime3, heartbeat_consumer(peer_b, config)),
        write(kSynchronousCounterOverflowValue, kSyncCounterMax),
        // After 1019h, which cannot be changed while 1006h is set; from here a node misses SYNCs.
        write(kCommunicationCyclePeriod, static_cast<std::uint32_t>(period_us)),
        // A number of SYNC periods, in ms.
        write(kRpdo1CommunicationParameterEventTimer,
              unsigned_ms(config.bus.deadline_periods * period_us / 1000)),
        write(kPositionEncoderResolutionEncoderIncrements,
              static_cast<std::uint32_t>(joint.increments_per_revolution)),
        write(kFollowingErrorWindow,
              scaled(kEnablingWindow_rad,
                     static_cast<double>(joint.increments_per_revolution) / (2.0 * M_PI))),
        write(kFicQAUrad, scaled(joint.q_a_rad, 1e6)),
        write(kFicQPUrad, scaled(joint.q_p_rad, 1e6)),
        write(kFicQBUrad, scaled(joint.q_b_rad, 1e6)),
        write(kFicTorqueLimitMNm, scaled(torque_limit_Nm, 1e3)),
        write(kFicDeltaInc256, scaled(joint.delta_inc, 256)),
        write(kFicStallTimeUs, scaled(joint.stall_time_s, 1e6)),
        write(kFicPhaseRule, joint.phase_rule == PhaseRule::body_motion ? 0 : 1),
        write(kFicJointTicksPerSync,
              static_cast<std::uint32_t>(config.joint.rate_Hz * period_us / 1000000)),
        write(kOutputBoundRampUpMs, scaled(joint.ramp_s, 1e3)),
        write(kOutputBoundRampDownMs, scaled(joint.ramp_s, 1e3)),
        write(kTimeBase, time_base == TimeBase::stepped ? 1 : 0),
        write(kSensorSource, config.sensors == Sensors::injected ? 1 : 0),
    };
}

} // namespace

std::array<std::vector<SdoWrite>, kJoints> node_configuration(const RunConfig &config,
                                                              TimeBase time_base) {
    return {one_node(config, time_base, 1), one_node(config, time_base, 2),
            one_node(config, time_base, 3)};
}

} // namespace hpmc
