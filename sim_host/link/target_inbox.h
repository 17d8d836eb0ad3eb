/**
 * Targets of the hand from outside the schedule: requests on ARM_TARGET (negative seq), as they
 * come in over LCM, and those of an earlier run's log, at the periods at which they acted there.
 *
 * Requests wait for their utime; of several due in one period the last one given wins. m, shoulder
 * at the origin. Reading the socket is left to every kPeriodsPerLook-th period: it costs a system
 * call, and a hand that drags a target does not notice.
 */
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "port/posix/lcm_udp.h"

namespace hpmc {

constexpr std::int32_t kOutsideTarget = -1; ///< arm_target_t.target

class TargetInbox {
  public:
    static constexpr std::int64_t kPeriodsPerLook = 8;
    static constexpr std::size_t kWaitingMax = 1 << 20;

    /// Hears requests on an LCM address. Throws LinkError.
    void listen(const std::string &url);
    /// Adds the targets from outside of a log. Throws LinkError when it cannot be read or holds
    /// none.
    void load(const std::string &log);

    /// The target that is to act with this period. Periods grow from call to call.
    std::optional<Eigen::Vector2d> take(std::int64_t period);

    /// Requests that could not be kept, or were no arm_target_t.
    std::int64_t dropped() const { return dropped_; }

  private:
    struct Request {
        std::int64_t utime;
        Eigen::Vector2d x_m;
    };
    struct Close {
        void operator()(lcm_udp_receiver_t *receiver) const;
    };

    void look();
    void keep(const Request &request);

    std::unique_ptr<lcm_udp_receiver_t, Close> receiver_;
    std::unique_ptr<lcm_udp_message_t> buffer_;
    std::vector<Request> waiting_; ///< the earliest last
    std::int64_t dropped_ = 0;
};

} // namespace hpmc
