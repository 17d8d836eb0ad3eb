#include <doctest/doctest.h>

#include <chrono>
#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <string>
#include <utility>
#include <vector>

#include "hpmc_lcm/bus_closed_t.hpp"
#include "hpmc_lcm/run_info_t.hpp"
#include "link/lcm_link.h"

using namespace hpmc;

namespace {

constexpr const char *kUrl = "udpm://239.255.76.67:7669?ttl=0";
constexpr int kShort_ms = 250;

hpmc_lcm::bus_closed_t message(std::int64_t seq) {
    hpmc_lcm::bus_closed_t result{};
    result.utime = 1000 * seq;
    result.seq = seq;
    result.node_frames[2] = 7;
    return result;
}

bool parses(const char *url) {
    lcm_udp_address_t address;
    return lcm_udp_parse(url, &address);
}

} // namespace

TEST_CASE("LCM addresses") {
    lcm_udp_address_t address;
    REQUIRE(lcm_udp_parse("udpm://239.255.76.67:7667?ttl=3", &address));
    CHECK(ntohl(address.group.sin_addr.s_addr) == 0xEFFF4C43U);
    CHECK(ntohs(address.group.sin_port) == 7667);
    CHECK(address.ttl == 3);
    REQUIRE(lcm_udp_parse("udpm://239.255.76.67:1", &address));
    CHECK(address.ttl == 0);
    for (const char *url :
         {"", "udpm://", "239.255.76.67:7667", "tcp://239.255.76.67:7667", "udpm://239.255.76.67",
          "udpm://239.255.76.67:0", "udpm://239.255.76.67:65536", "udpm://239.255.76:7667",
          "udpm://256.0.0.1:7667", "udpm://239.255.76.67:7667?ttl=256",
          "udpm://239.255.76.67:7667?ttl=-1"}) {
        CAPTURE(url);
        CHECK_FALSE(parses(url));
    }
}

TEST_CASE("a datagram that is not LCM is not taken apart") {
    lcm_udp_message_t m;
    const auto holds = [&m](const std::string &bytes) {
        std::memcpy(m.datagram, bytes.data(), bytes.size());
        return lcm_udp_take_apart(&m, bytes.size());
    };
    const std::string head("LC02\0\0\0\1", 8);
    REQUIRE(holds(head + std::string("CHANNEL\0data", 12)));
    CHECK(std::string(m.channel) == "CHANNEL");
    CHECK(m.payload_length == 4);
    CHECK(std::memcmp(m.payload, "data", 4) == 0);
    CHECK_FALSE(holds(""));
    CHECK_FALSE(holds(head));
    CHECK_FALSE(holds(head + "CHANNEL"));                                 // no end of the name
    CHECK_FALSE(holds("LC03" + head.substr(4) + std::string("C\0d", 3))); // a fragment
}

TEST_CASE("messages arrive in order, with a batch larger than the sender's") {
    LcmReceiver receiver(kUrl, "BUS_CLOSED", 1000);
    LcmSender sender(kUrl);
    for (std::int64_t seq = 0; seq < 50; ++seq) {
        sender.publish("BUS_CLOSED", message(seq));
    }
    sender.flush();
    for (std::int64_t seq = 0; seq < 50; ++seq) {
        hpmc_lcm::bus_closed_t got{};
        receiver.await(seq, got);
        CHECK(got.utime == 1000 * seq);
        CHECK(got.node_frames[2] == 7);
    }
    CHECK(sender.sent() == 50);
}

TEST_CASE("the kernel's filter passes one channel, not one with a similar name") {
    LcmReceiver receiver(kUrl, "ARM_STATE", kShort_ms);
    LcmSender sender(kUrl);
    for (const char *channel : {"ARM_STATE2", "ARM_STAT", "ARM_STATe", "XARM_STATE", "ARM", "A",
                                "JOINT_TORQUE_1", "ARM_STATE_AND_MORE"}) {
        sender.publish(channel, message(1));
    }
    sender.publish("ARM_STATE", message(2));
    sender.flush();
    hpmc_lcm::bus_closed_t got{};
    receiver.await(2, got);
    CHECK_THROWS_AS(receiver.await(3, got), LinkError);
}

TEST_CASE("a message lost, damaged, or too late is an error that names the channel") {
    LcmReceiver receiver(kUrl, "BUS_CLOSED", kShort_ms);
    LcmSender sender(kUrl);
    hpmc_lcm::bus_closed_t got{};
    SUBCASE("lost") {
        sender.publish("BUS_CLOSED", message(5));
        sender.flush();
        CHECK_THROWS_WITH_AS(receiver.await(4, got), "BUS_CLOSED 4: damaged or lost", LinkError);
    }
    SUBCASE("of another type") {
        hpmc_lcm::run_info_t other{};
        other.seq = 4;
        sender.publish("BUS_CLOSED", other);
        sender.flush();
        CHECK_THROWS_WITH_AS(receiver.await(4, got), "BUS_CLOSED 4: damaged or lost", LinkError);
    }
    SUBCASE("too late") {
        const auto begin = std::chrono::steady_clock::now();
        CHECK_THROWS_WITH_AS(receiver.await(4, got), "no BUS_CLOSED for 0 s", LinkError);
        CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(1));
    }
}

TEST_CASE("a message or channel name that is too long is refused, the next one is sent") {
    LcmReceiver receiver(kUrl, "BUS_CLOSED", 1000);
    LcmSender sender(kUrl);
    hpmc_lcm::run_info_t info{};
    info.config_toml = std::string(10000, 'x');
    CHECK_THROWS_WITH_AS(sender.publish("RUN_INFO", info), "cannot send on channel RUN_INFO",
                         LinkError);
    CHECK_THROWS_AS(sender.publish(std::string(64, 'N').c_str(), message(0)), LinkError);
    sender.publish("BUS_CLOSED", message(1));
    sender.flush();
    hpmc_lcm::bus_closed_t got{};
    receiver.await(1, got);
}

TEST_CASE("the stock library understands what is sent here") {
    lcm::LCM stock(kUrl);
    REQUIRE(stock.good());
    std::vector<std::pair<std::string, std::int64_t>> got;
    const lcm::LCM::HandlerFunction<hpmc_lcm::bus_closed_t> note =
        [&got](const lcm::ReceiveBuffer *, const std::string &channel,
               const hpmc_lcm::bus_closed_t *m) { got.emplace_back(channel, m->seq); };
    stock.subscribe("BUS_.*", note);
    LcmSender sender(kUrl);
    sender.publish("OTHER", message(1));
    sender.publish("BUS_CLOSED", message(2));
    sender.publish("BUS_CLOSED", message(3));
    sender.flush();
    while (got.size() < 2 && stock.handleTimeout(1000) > 0) {
    }
    CHECK(got ==
          std::vector<std::pair<std::string, std::int64_t>>{{"BUS_CLOSED", 2}, {"BUS_CLOSED", 3}});
}

TEST_CASE("what the stock library sends is understood here") {
    LcmReceiver one(kUrl, "BUS_CLOSED", 1000);
    LcmReceiver all(kUrl, "", 1000);
    lcm::LCM stock(kUrl);
    REQUIRE(stock.good());
    const hpmc_lcm::bus_closed_t first = message(1);
    const hpmc_lcm::bus_closed_t second = message(2);
    stock.publish("SOMETHING", &first);
    stock.publish("BUS_CLOSED", &second);
    hpmc_lcm::bus_closed_t got{};
    one.await(2, got);
    CHECK(got.node_frames[2] == 7);
    all.await(1, got);
    all.await(2, got);
}
