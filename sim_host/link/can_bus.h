/**
 * SocketCAN for the host (C++ side of port/posix/can_socket.h).
 */
#pragma once

#include <string>
#include <vector>

#include "link/bus_closing.h"
#include "port/posix/can_socket.h"

namespace hpmc {

class CanBus {
  public:
    /// Receives all frames, or with filters those that pass one. Throws LinkError when the
    /// interface cannot be used.
    explicit CanBus(const std::string &interface,
                    const std::vector<can_socket_filter_t> &filters = {});
    ~CanBus();
    CanBus(const CanBus &) = delete;
    CanBus &operator=(const CanBus &) = delete;

    void send(const can_frame_t *frames, std::size_t count);
    /// Appends exactly `count` frames; throws LinkError when one is missing.
    void receive(std::size_t count, PeriodFrames &frames);
    /// Waits for a frame, appends it and all that are there; false when none came in time.
    bool receive_some(PeriodFrames &frames, int timeout_ms);
    /// Appends the frames that are there, without waiting.
    void receive_available(PeriodFrames &frames);

    const can_socket_t &socket() const { return socket_; }

  private:
    std::string interface_;
    can_socket_t socket_{};
};

} // namespace hpmc
