#include "link/lcm_link.h"

#include <cerrno>
#include <cstring>

#include "port/posix/stop_signal.h"

namespace hpmc {
namespace {

constexpr int kPoll_ms = 250; ///< a blocking receive looks at the stop flag this often
constexpr int kReceiveBufferBytes = 4 << 20;
constexpr std::size_t kMessageBytesMax = 1 << 16;
constexpr std::size_t kLogBufferBytes = 1 << 20; ///< a write is dear in user-mode Linux

} // namespace

lcm_udp_address_t parse_lcm_url(const std::string &url) {
    lcm_udp_address_t address;
    if (!lcm_udp_parse(url.c_str(), &address)) {
        throw LinkError("LCM address '" + url + "': must be udpm://A.B.C.D:PORT?ttl=N");
    }
    return address;
}

LcmSender::LcmSender(const std::string &url) : sender_(std::make_unique<lcm_udp_sender_t>()) {
    const lcm_udp_address_t address = parse_lcm_url(url);
    if (!lcm_udp_sender_open(sender_.get(), &address)) {
        throw LinkError("LCM " + url + ": " + std::strerror(errno));
    }
}

LcmSender::~LcmSender() {
    lcm_udp_sender_close(sender_.get());
}

void LcmSender::flush() {
    if (!lcm_udp_flush(sender_.get())) {
        throw LinkError(std::string("LCM: cannot send: ") + std::strerror(errno));
    }
}

LcmReceiver::LcmReceiver(const std::string &url, const std::string &channel, int stall_timeout_ms)
    : channel_(channel), stall_timeout_ms_(stall_timeout_ms),
      buffer_(std::make_unique<lcm_udp_message_t>()) {
    const lcm_udp_address_t address = parse_lcm_url(url);
    if (!lcm_udp_receiver_open(&receiver_, &address, channel.empty() ? nullptr : channel.c_str(),
                               kReceiveBufferBytes) ||
        !lcm_udp_set_timeout(&receiver_, kPoll_ms)) {
        throw LinkError("LCM " + url + ": " + std::strerror(errno) +
                        (errno == ENODEV ? " (no multicast route; tools/with-vcan sets one)" : ""));
    }
}

LcmReceiver::~LcmReceiver() {
    lcm_udp_receiver_close(&receiver_);
}

void LcmReceiver::wait(bool stoppable) {
    for (int waited_ms = 0; waited_ms < stall_timeout_ms_; waited_ms += kPoll_ms) {
        const int got = lcm_udp_receive(&receiver_, buffer_.get());
        if (got > 0) {
            return;
        }
        if (got < 0) {
            throw LinkError(channel_ + ": " + std::strerror(errno));
        }
        if (stoppable && stop_signal_raised()) {
            throw StopRequested{};
        }
    }
    throw LinkError("no " + channel_ + " for " + std::to_string(stall_timeout_ms_ / 1000) + " s");
}

LcmLogWriter::LcmLogWriter(const std::string &path)
    : log_(lcm_eventlog_create(path.c_str(), "w")), buffer_(kMessageBytesMax) {
    if (!log_) {
        throw LinkError(path + ": " + std::strerror(errno));
    }
    std::setvbuf(log_->f, nullptr, _IOFBF, kLogBufferBytes);
}

void LcmLogWriter::write(const char *channel, std::int64_t utime, const void *data, int length) {
    lcm_eventlog_event_t event{};
    event.timestamp = utime;
    event.channellen = static_cast<std::int32_t>(std::strlen(channel));
    event.datalen = length;
    // liblcm's structure has no const; lcm_eventlog_write_event only reads.
    event.channel = const_cast<char *>(channel);
    event.data = const_cast<void *>(data);
    if (lcm_eventlog_write_event(log_.get(), &event) != 0) {
        throw LinkError(std::string("log: ") + std::strerror(errno));
    }
    ++written_;
}

void LcmLogWriter::flush() {
    std::fflush(log_->f);
}

} // namespace hpmc
