/**
 * The arm's sensors and motors over the bus: RPDO4 frames from joint angles, torques from TPDO1.
 */
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "link/bus_closing.h"

namespace hpmc {

class InjectedSensors {
  public:
    explicit InjectedSensors(std::int64_t increments_per_revolution)
        : increments_per_revolution_(static_cast<std::uint32_t>(increments_per_revolution)) {}

    /// Appends one RPDO4 per node: position, tick (low byte of period), flags 0, temperature.
    void inject(const Eigen::Vector3d &q_rad, std::int64_t period, PeriodFrames &frames) const;

    /// Torques for the plant after a period in which the nodes sent `frames`: 6077h of TPDO1. A
    /// node that sent none keeps its torque for kHoldPeriods, then counts as without torque.
    Eigen::Vector3d torque_Nm(const PeriodFrames &frames);

    void reset();

  private:
    static constexpr int kHoldPeriods = 2;

    std::uint32_t increments_per_revolution_;
    Eigen::Vector3d torque_Nm_ = Eigen::Vector3d::Zero();
    std::array<int, kNodes> periods_silent_{};
};

} // namespace hpmc
