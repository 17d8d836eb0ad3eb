/**
 * LCM messages to and from the lockstep loop (C++ side of port/posix/lcm_udp.h), and to a log file.
 *
 * Both senders offer publish(channel, message); the run clock in the message's utime is also the
 * time of the event in a log.
 */
#pragma once

#include <array>
#include <cstdint>
#include <lcm/lcm.h>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "port/posix/lcm_udp.h"

namespace hpmc {

constexpr const char *kDefaultPlantUrl = "udpm://239.255.76.67:7668?ttl=0";
constexpr const char *kDefaultTelemetryUrl = "udpm://239.255.76.67:7667?ttl=0";

/// A peer fell silent, or a message is damaged or was lost: the run ends with exit status 3.
struct LinkError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Thrown out of a wait when SIGTERM or SIGINT came.
struct StopRequested {};

lcm_udp_address_t parse_lcm_url(const std::string &url);

class LcmSender {
  public:
    explicit LcmSender(const std::string &url);
    ~LcmSender();
    LcmSender(const LcmSender &) = delete;
    LcmSender &operator=(const LcmSender &) = delete;

    /// Queues a message; flush() sends what is queued in one system call.
    template <class Message> void publish(const char *channel, const Message &message) {
        std::size_t capacity = 0;
        std::uint8_t *payload = lcm_udp_reserve(sender_.get(), channel, &capacity);
        const int length =
            payload == nullptr ? -1 : message.encode(payload, 0, static_cast<int>(capacity));
        if (length < 0) {
            throw LinkError(std::string("cannot send on channel ") + channel);
        }
        lcm_udp_commit(sender_.get(), static_cast<std::size_t>(length));
        ++sent_;
    }
    void flush();
    std::int64_t sent() const { return sent_; }

  private:
    std::unique_ptr<lcm_udp_sender_t> sender_;
    std::int64_t sent_ = 0;
};

/// Blocking reader of one channel (or of all, with an empty name).
class LcmReceiver {
  public:
    LcmReceiver(const std::string &url, const std::string &channel, int stall_timeout_ms);
    ~LcmReceiver();
    LcmReceiver(const LcmReceiver &) = delete;
    LcmReceiver &operator=(const LcmReceiver &) = delete;

    /// Waits for the next message and checks its sequence number. Throws LinkError when none comes
    /// within the stall time-out, or it is not number `seq`; StopRequested when asked to stop and
    /// `stoppable`.
    template <class Message> void await(std::int64_t seq, Message &message, bool stoppable = true) {
        wait(stoppable);
        if (message.decode(buffer_->payload, 0, buffer_->payload_length) < 0 ||
            message.seq != seq) {
            throw LinkError(channel_ + " " + std::to_string(seq) + ": damaged or lost");
        }
    }

  private:
    void wait(bool stoppable);

    std::string channel_;
    int stall_timeout_ms_;
    lcm_udp_receiver_t receiver_{};
    std::unique_ptr<lcm_udp_message_t> buffer_;
};

/// Writes messages into an LCM event log.
class LcmLogWriter {
  public:
    /// Throws LinkError when the file cannot be made.
    explicit LcmLogWriter(const std::string &path);

    template <class Message> void publish(const char *channel, const Message &message) {
        const int length = message.encode(buffer_.data(), 0, static_cast<int>(buffer_.size()));
        if (length < 0) {
            throw LinkError(std::string("message too long on channel ") + channel);
        }
        write(channel, message.utime, buffer_.data(), length);
    }
    /// Writes an encoded message.
    void write(const char *channel, std::int64_t utime, const void *data, int length);
    void flush();
    std::int64_t written() const { return written_; }

  private:
    struct Close {
        void operator()(lcm_eventlog_t *log) const { lcm_eventlog_destroy(log); }
    };
    std::unique_ptr<lcm_eventlog_t, Close> log_;
    std::vector<std::uint8_t> buffer_;
    std::int64_t written_ = 0;
};

} // namespace hpmc
