#include "link/can_bus.h"

#include <cerrno>
#include <cstring>

#include "link/lcm_link.h"

namespace hpmc {
namespace {

constexpr int kFrameWait_ms = 500; ///< vcan delivers at once: a frame missing for so long is lost

} // namespace

CanBus::CanBus(const std::string &interface, const std::vector<can_socket_filter_t> &filters)
    : interface_(interface) {
    if (!can_socket_open(&socket_, interface.c_str(), filters.empty() ? nullptr : filters.data(),
                         filters.size())) {
        throw LinkError("CAN interface " + interface + ": " + std::strerror(errno));
    }
}

CanBus::~CanBus() {
    can_socket_close(&socket_);
}

void CanBus::send(const can_frame_t *frames, std::size_t count) {
    if (!can_socket_send(&socket_, frames, count, kFrameWait_ms)) {
        throw LinkError(interface_ + ": cannot send: " + std::strerror(errno));
    }
}

void CanBus::receive(std::size_t count, PeriodFrames &frames) {
    std::array<can_frame_t, PeriodFrames::kMax> received;
    if (count > received.size()) {
        throw LinkError(interface_ + ": more frames in a period than the host takes");
    }
    const std::size_t got = can_socket_receive(&socket_, received.data(), count, kFrameWait_ms);
    if (got != count) {
        throw LinkError(interface_ + ": " + std::to_string(count - got) + " of " +
                        std::to_string(count) + " frames were lost");
    }
    frames.append(received.data(), got);
}

bool CanBus::receive_some(PeriodFrames &frames, int timeout_ms) {
    can_frame_t first;
    if (can_socket_receive(&socket_, &first, 1, timeout_ms) == 0) {
        return false;
    }
    frames.append(&first, 1);
    receive_available(frames);
    return true;
}

void CanBus::receive_available(PeriodFrames &frames) {
    std::array<can_frame_t, PeriodFrames::kMax> received;
    frames.append(received.data(),
                  can_socket_receive(&socket_, received.data(), received.size(), 0));
}

} // namespace hpmc
