#include <doctest/doctest.h>

#include "hpmc_lcm/arm_target_t.hpp"
#include "hpmc_lcm/hand_wrench_t.hpp"
#include "link/lcm_link.h"
#include "link/target_inbox.h"

using namespace hpmc;

namespace {

constexpr const char *kUrl = "udpm://239.255.76.67:7671?ttl=0";
constexpr std::int64_t kLook = TargetInbox::kPeriodsPerLook;

class Asker {
  public:
    void ask(double x_m, std::int64_t utime = 0, std::int64_t seq = -1) {
        hpmc_lcm::arm_target_t message{};
        message.utime = utime;
        message.seq = seq;
        message.x_t_m[0] = x_m;
        message.target = kOutsideTarget;
        sender_.publish("ARM_TARGET", message);
        sender_.flush();
    }

  private:
    LcmSender sender_{kUrl};
};

} // namespace

// Loopback delivers within the sending call, so nothing has to be waited for.

TEST_CASE("a request acts with the next look, the last of several") {
    TargetInbox inbox;
    inbox.listen(kUrl);
    Asker asker;
    CHECK_FALSE(inbox.take(0));
    asker.ask(0.1);
    asker.ask(0.2);
    CHECK_FALSE(inbox.take(kLook - 1));
    const auto target = inbox.take(kLook);
    REQUIRE(target);
    CHECK(target->x() == 0.2);
    CHECK_FALSE(inbox.take(2 * kLook));
    CHECK(inbox.dropped() == 0);
}

TEST_CASE("a request with a time waits for it, whatever the order of asking") {
    TargetInbox inbox;
    inbox.listen(kUrl);
    Asker asker;
    asker.ask(0.3, 30000);
    asker.ask(0.2, 20000);
    CHECK_FALSE(inbox.take(2 * kLook));
    CHECK_FALSE(inbox.take(19));
    CHECK(inbox.take(20)->x() == 0.2);
    CHECK_FALSE(inbox.take(29));
    CHECK(inbox.take(30)->x() == 0.3);
}

TEST_CASE("what the host itself publishes is no request; a message of another type is counted") {
    TargetInbox inbox;
    inbox.listen(kUrl);
    Asker asker;
    asker.ask(0.1, 0, 7);
    CHECK_FALSE(inbox.take(kLook));
    CHECK(inbox.dropped() == 0);
    LcmSender sender(kUrl);
    sender.publish("ARM_TARGET", hpmc_lcm::hand_wrench_t{});
    sender.flush();
    CHECK_FALSE(inbox.take(2 * kLook));
    CHECK(inbox.dropped() == 1);
}

TEST_CASE("an address that is none is said so") {
    TargetInbox inbox;
    CHECK_THROWS_AS(inbox.listen("tcp://localhost"), LinkError);
}
