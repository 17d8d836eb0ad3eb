/**
 * The plant's state as the messages ARM_STATE and HAND_WRENCH: one place for arm_sim and sil.
 */
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "hpmc_lcm/arm_state_t.hpp"
#include "hpmc_lcm/hand_wrench_t.hpp"
#include "plant/arm_plant.h"

namespace hpmc {

inline void fill_arm_state(const ArmPlantState &state, const Eigen::Vector3d &tau_Nm,
                           hpmc_lcm::arm_state_t &message) {
    for (int i = 0; i < 3; ++i) {
        message.q_rad[i] = state.q_rad[i];
        message.qd_rad_s[i] = state.qd_rad_s[i];
        message.tau_Nm[i] = tau_Nm[i];
    }
    for (int i = 0; i < 2; ++i) {
        message.hand_m[i] = state.hand_m[i];
        message.hand_m_s[i] = state.hand_m_s[i];
        message.wrench_N[i] = state.wrench_N[i];
    }
}

inline void fill_hand_wrench(const ArmPlantState &state,
                             const std::array<std::int32_t, 3> &frames_sent,
                             hpmc_lcm::hand_wrench_t &message) {
    for (std::size_t i = 0; i < 2; ++i) {
        message.wrench_N[i] = state.wrench_N[static_cast<Eigen::Index>(i)];
    }
    std::copy(frames_sent.begin(), frames_sent.end(), message.frames_sent);
}

} // namespace hpmc
