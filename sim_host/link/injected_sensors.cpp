#include "link/injected_sensors.h"

#include "port/posix/encoder_model.h"

namespace hpmc {
namespace {

constexpr std::uint16_t kTpdo1 = 0x180;
constexpr std::uint16_t kRpdo4 = 0x500;
constexpr std::int16_t kAmbient_dC = 250;

} // namespace

void InjectedSensors::inject(const Eigen::Vector3d &q_rad, std::int64_t period,
                             PeriodFrames &frames) const {
    for (std::size_t node = 1; node <= kNodes; ++node) {
        const auto position = static_cast<std::uint32_t>(encoder_model_increments(
            q_rad[static_cast<Eigen::Index>(node - 1)], increments_per_revolution_));
        can_frame_t frame{};
        frame.id = static_cast<std::uint16_t>(kRpdo4 + node);
        frame.len = 8;
        for (unsigned i = 0; i < 4; ++i) {
            frame.data[i] = static_cast<std::uint8_t>(position >> (8U * i) & 0xFFU);
        }
        frame.data[4] = static_cast<std::uint8_t>(period & 0xFF);
        frame.data[5] = 0;
        frame.data[6] = kAmbient_dC & 0xFF;
        frame.data[7] = kAmbient_dC >> 8;
        frames.append(&frame, 1);
    }
}

Eigen::Vector3d InjectedSensors::torque_Nm(const PeriodFrames &frames) {
    for (int &silent : periods_silent_) {
        ++silent;
    }
    for (std::size_t i = 0; i < frames.count; ++i) {
        const can_frame_t &frame = frames.frames[i];
        const std::size_t node = static_cast<std::size_t>(frame.id - kTpdo1);
        if (frame.id > kTpdo1 && node <= kNodes && frame.len == 8) {
            const auto torque_mNm = static_cast<std::int16_t>(frame.data[4] | frame.data[5] << 8U);
            torque_Nm_[static_cast<Eigen::Index>(node - 1)] = torque_mNm / 1000.0;
            periods_silent_[node - 1] = 0;
        }
    }
    for (std::size_t i = 0; i < kNodes; ++i) {
        if (periods_silent_[i] > kHoldPeriods) {
            torque_Nm_[static_cast<Eigen::Index>(i)] = 0.0;
        }
    }
    return torque_Nm_;
}

void InjectedSensors::reset() {
    torque_Nm_.setZero();
    periods_silent_ = {};
}

} // namespace hpmc
