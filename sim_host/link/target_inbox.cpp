#include "link/target_inbox.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <lcm/lcm.h>

#include "hpmc_lcm/arm_target_t.hpp"
#include "link/lcm_link.h"

namespace hpmc {
namespace {

constexpr const char *kChannel = "ARM_TARGET";
constexpr int kReceiveBufferBytes = 1 << 18;
constexpr std::int64_t kPeriod_us = 1000;
constexpr int kLookedMax = 64; ///< datagrams a call takes in: a flood must not hold up the period

struct CloseLog {
    void operator()(lcm_eventlog_t *log) const { lcm_eventlog_destroy(log); }
};
struct FreeEvent {
    void operator()(lcm_eventlog_event_t *event) const { lcm_eventlog_free_event(event); }
};

} // namespace

void TargetInbox::Close::operator()(lcm_udp_receiver_t *receiver) const {
    lcm_udp_receiver_close(receiver);
    delete receiver;
}

void TargetInbox::listen(const std::string &url) {
    const lcm_udp_address_t address = parse_lcm_url(url);
    auto receiver = std::make_unique<lcm_udp_receiver_t>();
    if (!lcm_udp_receiver_open(receiver.get(), &address, kChannel, kReceiveBufferBytes)) {
        throw LinkError("LCM " + url + ": " + std::strerror(errno));
    }
    receiver_.reset(receiver.release());
    if (fcntl(receiver_->fd, F_SETFL, O_NONBLOCK) != 0) {
        throw LinkError("LCM " + url + ": " + std::strerror(errno));
    }
    buffer_ = std::make_unique<lcm_udp_message_t>();
}

void TargetInbox::load(const std::string &path) {
    const std::unique_ptr<lcm_eventlog_t, CloseLog> log(lcm_eventlog_create(path.c_str(), "r"));
    if (!log) {
        throw LinkError("targets: " + path + ": " + std::strerror(errno));
    }
    const std::size_t before = waiting_.size();
    while (const std::unique_ptr<lcm_eventlog_event_t, FreeEvent> event{
        lcm_eventlog_read_next_event(log.get())}) {
        hpmc_lcm::arm_target_t message{};
        if (std::string_view(event->channel, static_cast<std::size_t>(event->channellen)) ==
                kChannel &&
            message.decode(event->data, 0, event->datalen) >= 0 &&
            message.target == kOutsideTarget && message.seq >= 0) {
            keep({message.utime, {message.x_t_m[0], message.x_t_m[1]}});
        }
    }
    if (waiting_.size() == before) {
        throw LinkError("targets: " + path + ": holds no target from outside the schedule");
    }
}

void TargetInbox::keep(const Request &request) {
    if (waiting_.size() >= kWaitingMax) {
        ++dropped_;
        return;
    }
    // The later of two with one time is found first, so that it is taken last.
    const auto at =
        std::lower_bound(waiting_.begin(), waiting_.end(), request,
                         [](const Request &a, const Request &b) { return a.utime > b.utime; });
    waiting_.insert(at, request);
}

void TargetInbox::look() {
    for (int looked = 0; looked < kLookedMax; ++looked) {
        const ssize_t length = recv(receiver_->fd, buffer_->datagram, sizeof buffer_->datagram, 0);
        if (length < 0) {
            return;
        }
        hpmc_lcm::arm_target_t message{};
        if (!lcm_udp_take_apart(buffer_.get(), static_cast<std::size_t>(length)) ||
            message.decode(buffer_->payload, 0, buffer_->payload_length) < 0) {
            ++dropped_;
        } else if (message.seq < 0) {
            keep({message.utime, {message.x_t_m[0], message.x_t_m[1]}});
        }
    }
}

std::optional<Eigen::Vector2d> TargetInbox::take(std::int64_t period) {
    if (receiver_ && period % kPeriodsPerLook == 0) {
        look();
    }
    std::optional<Eigen::Vector2d> target;
    while (!waiting_.empty() && waiting_.back().utime <= period * kPeriod_us) {
        target = waiting_.back().x_m;
        waiting_.pop_back();
    }
    return target;
}

} // namespace hpmc
