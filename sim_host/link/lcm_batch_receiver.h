/**
 * Reads the messages that have gathered on an LCM address without waiting, many in one system call:
 * for those who look on and come by now and then. Losses show in the messages' own numbers.
 */
#pragma once

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <string>
#include <sys/socket.h>

#include "link/lcm_link.h"

namespace hpmc {

class LcmBatchReceiver {
  public:
    /// One channel, or all when it is nullptr. Throws LinkError.
    LcmBatchReceiver(const std::string &url, const char *channel, int buffer_bytes)
        : datagrams_(std::make_unique<lcm_udp_message_t[]>(kMessagesPerCall)) {
        const lcm_udp_address_t address = parse_lcm_url(url);
        if (!lcm_udp_receiver_open(&receiver_, &address, channel, buffer_bytes)) {
            throw LinkError("LCM " + url + ": " + std::strerror(errno));
        }
    }
    ~LcmBatchReceiver() { lcm_udp_receiver_close(&receiver_); }
    LcmBatchReceiver(const LcmBatchReceiver &) = delete;
    LcmBatchReceiver &operator=(const LcmBatchReceiver &) = delete;

    /// Hands every waiting message to `take`.
    template <class Take> void drain(Take &&take) {
        std::array<iovec, kMessagesPerCall> parts{};
        std::array<mmsghdr, kMessagesPerCall> headers{};
        int n = 0;
        do {
            for (std::size_t i = 0; i < kMessagesPerCall; ++i) {
                parts[i] = {datagrams_[i].datagram, sizeof datagrams_[i].datagram};
                headers[i] = {};
                headers[i].msg_hdr.msg_iov = &parts[i];
                headers[i].msg_hdr.msg_iovlen = 1;
            }
            n = recvmmsg(receiver_.fd, headers.data(), kMessagesPerCall, MSG_DONTWAIT, nullptr);
            for (int i = 0; i < n; ++i) {
                lcm_udp_message_t &message = datagrams_[static_cast<std::size_t>(i)];
                if (lcm_udp_take_apart(&message, headers[static_cast<std::size_t>(i)].msg_len)) {
                    take(message);
                }
            }
        } while (n == static_cast<int>(kMessagesPerCall));
    }

    int fd() const { return receiver_.fd; }

  private:
    static constexpr std::size_t kMessagesPerCall = 64;

    lcm_udp_receiver_t receiver_{};
    std::unique_ptr<lcm_udp_message_t[]> datagrams_;
};

/// A field of eight bytes of an encoded message.
inline std::int64_t big_endian_i64(const std::uint8_t *at) {
    std::uint64_t value = 0;
    for (int i = 0; i < 8; ++i) {
        value = value << 8U | at[i];
    }
    return static_cast<std::int64_t>(value);
}

} // namespace hpmc
