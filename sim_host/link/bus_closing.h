/**
 * Which frames of a SYNC period reach which node: the closing of a tick (docs/architecture.md).
 */
#pragma once

#include <array>
#include <cstddef>

#include "canopen/can_frame.h"

namespace hpmc {

constexpr std::size_t kNodes = 3;

/// Frames of one period, in the order in which they are on the bus.
struct PeriodFrames {
    static constexpr std::size_t kMax = 64;

    std::array<can_frame_t, kMax> frames;
    std::size_t count = 0;
    std::size_t dropped = 0; ///< frames beyond kMax, counted

    void append(const can_frame_t *begin, std::size_t n);
    /// By identifier, as arbitration would have it; frames of equal identifier keep their order.
    void sort_by_identifier();
};

/// 1..kNodes when the frame comes from a motor node, 0 when from the host, 127 for RPDO4 (sensors).
int sender_of(const can_frame_t &frame);

/// Appends the frames of `from` that node `node_id` accepts and did not send itself.
void deliver(int node_id, const PeriodFrames &from, PeriodFrames &inbox);

} // namespace hpmc
