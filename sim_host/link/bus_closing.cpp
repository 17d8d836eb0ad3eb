#include "link/bus_closing.h"

#include <algorithm>
#include <cstdint>

extern "C" {
#include "node/motor_node.h"
}

namespace hpmc {

void PeriodFrames::append(const can_frame_t *begin, std::size_t n) {
    const std::size_t room = std::min(n, kMax - count);
    std::copy_n(begin, room, frames.begin() + static_cast<std::ptrdiff_t>(count));
    count += room;
    dropped += n - room;
}

void PeriodFrames::sort_by_identifier() {
    // Insertion sort: stable, without a buffer, and the frames are few and nearly in order.
    for (std::size_t i = 1; i < count; ++i) {
        for (std::size_t j = i; j > 0 && frames[j].id < frames[j - 1].id; --j) {
            std::swap(frames[j], frames[j - 1]);
        }
    }
}

int sender_of(const can_frame_t &frame) {
    constexpr int kSensors = 127;
    const int node = frame.id & 0x7F;
    switch (frame.id & 0x780) {
    case 0x080: // EMCY; SYNC is node 0
    case 0x180: // TPDO1
    case 0x280: // TPDO2
    case 0x580: // SDO answer
    case 0x700: // heartbeat; the host's is 127
        return node <= static_cast<int>(kNodes) ? node : 0;
    case 0x500: // RPDO4
        return kSensors;
    default:
        return 0;
    }
}

void deliver(int node_id, const PeriodFrames &from, PeriodFrames &inbox) {
    for (std::size_t i = 0; i < from.count; ++i) {
        const can_frame_t &frame = from.frames[i];
        if (sender_of(frame) != node_id &&
            motor_node_accepts(static_cast<std::uint8_t>(node_id), frame.id)) {
            inbox.append(&frame, 1);
        }
    }
}

} // namespace hpmc
