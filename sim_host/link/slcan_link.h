/**
 * CAN over a serial line as SLCAN (port/slcan/slcan.h): to a motor node that is served over a line
 * (an emulated board, or a board without a transceiver), or to a USB adapter with SLCAN firmware.
 *
 * A node answers every line when it has taken the frame in (slcan_node.h), an adapter at once, with
 * CR, with "z" and CR, or not at all. All waits are bounded. A refused line, a garbled one and a
 * line that the other end has closed end the run: LinkError says which and of whom.
 */
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <string>

#include "link/bus_closing.h"
#include "port/slcan/slcan.h"

namespace hpmc {

struct SlcanStats {
    std::int64_t lines_sent = 0;
    std::int64_t frames_received = 0;
    std::int64_t refused = 0; ///< lines answered with BEL
    std::int64_t garbled = 0; ///< received lines that are none
    std::int64_t ignored = 0; ///< 29-bit and remote frames of an adapter's bus
};

class SlcanLink {
  public:
    static constexpr int kTimeout_ms = 10000;

    /// address: slcan:tcp:HOST:PORT, slcan:DEVICE or slcan:DEVICE@BAUD (1000000, that of the
    /// board's USART, when left out; a USB adapter does not care). owner: whose line it is, for
    /// error texts. Throws LinkError when the address is none or nobody is there.
    SlcanLink(const std::string &address, const std::string &owner, int timeout_ms = kTimeout_ms);
    /// Takes over an open, bidirectional descriptor.
    SlcanLink(int fd, std::string owner, int timeout_ms = kTimeout_ms);
    ~SlcanLink(); ///< closes the channel
    SlcanLink(const SlcanLink &) = delete;
    SlcanLink &operator=(const SlcanLink &) = delete;

    /// Opens the channel of a node, which may be starting still; whatever came before is skipped.
    void open_node();
    /// Opens the channel of an adapter, at 1 Mbit/s. Its answers are not waited for.
    void open_adapter();

    /// Sends the frames, without waiting for answers.
    void send(const can_frame_t *frames, std::size_t count);
    /// Waits until a node has answered every line sent; appends the frames that came meanwhile.
    void await_answers(PeriodFrames &frames);
    /// Appends exactly `count` frames.
    void receive(std::size_t count, PeriodFrames &frames);
    /// Appends the frames that are there, without waiting.
    void receive_available(PeriodFrames &frames);

    const SlcanStats &stats() const { return stats_; }

  private:
    using Clock = std::chrono::steady_clock;

    [[noreturn]] void fail(const std::string &what) const;
    Clock::time_point deadline() const;
    /// Waits for POLLIN or POLLOUT; false at the deadline.
    bool wait_for(short event, Clock::time_point until) const;
    void write(const char *text, std::size_t length);
    /// Reads what is there into the buffer; false when there is nothing.
    bool fill();
    /// Takes lines out of the buffer until `done` or the buffer is empty, and reads on until the
    /// deadline; false when it came first.
    template <class Done> bool take_until(Done done, PeriodFrames &frames);
    void take(std::uint8_t byte, PeriodFrames &frames);
    void take_line(PeriodFrames &frames);
    void take_answer();
    void synchronise();
    /// Throws away what comes, up to a line that begins with this character; false at the deadline.
    bool skip_to(char command, Clock::time_point until);

    std::string owner_;
    int timeout_ms_;
    int fd_ = -1;
    bool socket_ = false;
    slcan_line_t line_{};
    bool counts_answers_ = true; ///< false: an adapter
    std::size_t unanswered_ = 0;
    std::array<std::uint8_t, 4096> buffer_;
    std::size_t buffer_first_ = 0; ///< received and not yet taken: from here
    std::size_t buffer_end_ = 0;   ///< to here
    SlcanStats stats_;
};

} // namespace hpmc
