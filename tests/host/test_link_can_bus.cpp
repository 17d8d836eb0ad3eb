#include <doctest/doctest.h>

#include <chrono>
#include <vector>

#include "link/can_bus.h"
#include "link/lcm_link.h"

extern "C" {
#include "node/motor_node.h"
#include "port/posix/node_filters.h"
}

using namespace hpmc;

namespace {

can_frame_t numbered(unsigned id, unsigned number) {
    can_frame_t f{};
    f.id = static_cast<std::uint16_t>(id);
    f.len = 4;
    for (unsigned i = 0; i < 4; ++i) {
        f.data[i] = static_cast<std::uint8_t>(number >> (8U * i));
    }
    return f;
}

} // namespace

TEST_CASE("CAN: frames arrive in order and whole, and not at their sender") {
    CanBus sender("vcan0");
    CanBus receiver("vcan0");
    std::vector<can_frame_t> frames;
    for (unsigned i = 0; i < 60; ++i) {
        frames.push_back(numbered(0x100 + i, i * 0x01010101U));
        frames.back().len = static_cast<std::uint8_t>(i % 9);
    }
    sender.send(frames.data(), frames.size());
    PeriodFrames received{};
    receiver.receive(frames.size(), received);
    REQUIRE(received.count == frames.size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
        CHECK(received.frames[i].id == frames[i].id);
        REQUIRE(received.frames[i].len == frames[i].len);
        for (unsigned byte = 0; byte < 8; ++byte) {
            const unsigned sent = byte < frames[i].len ? frames[i].data[byte] : 0U;
            CHECK(received.frames[i].data[byte] == sent);
        }
    }
    PeriodFrames own{};
    sender.receive_available(own);
    CHECK(own.count == 0);
    CHECK(receiver.socket().dropped == 0);
}

TEST_CASE("CAN: thousands of frames wait in the socket without a loss") {
    CanBus sender("vcan0");
    CanBus receiver("vcan0");
    constexpr unsigned kFrames = 6400;
    for (unsigned first = 0; first < kFrames; first += 64) {
        std::vector<can_frame_t> batch;
        for (unsigned i = 0; i < 64; ++i) {
            batch.push_back(numbered(0x123, first + i));
        }
        sender.send(batch.data(), batch.size());
    }
    for (unsigned first = 0; first < kFrames; first += 64) {
        PeriodFrames received{};
        receiver.receive(64, received);
        CHECK(received.frames[0].data[0] == (first & 0xFFU));
        CHECK(received.frames[63].data[1] == (first + 63) >> 8U);
    }
    CHECK(receiver.socket().dropped == 0);
}

TEST_CASE("CAN: a frame that does not come is an error within a second, with its number") {
    CanBus sender("vcan0");
    CanBus receiver("vcan0");
    const can_frame_t one = numbered(0x181, 1);
    sender.send(&one, 1);
    PeriodFrames received{};
    const auto begin = std::chrono::steady_clock::now();
    CHECK_THROWS_WITH_AS(receiver.receive(3, received), "vcan0: 2 of 3 frames were lost",
                         LinkError);
    CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(1));
}

TEST_CASE("CAN: an interface that is not there") {
    CHECK_THROWS_WITH_AS(CanBus("nocan0"), "CAN interface nocan0: No such device", LinkError);
}

TEST_CASE("CAN: a node's socket passes just what the node accepts") {
    std::vector<can_socket_filter_t> filters(NODE_FILTERS_COUNT);
    node_filters(2, filters.data());
    CanBus node("vcan0", filters);
    CanBus others("vcan0");
    std::vector<unsigned> expected;
    std::vector<unsigned> passed;
    for (unsigned id = 0; id <= 0x7FF; ++id) {
        if (id == 0x082 || id == 0x702 || id == 0x700) {
            continue; // its own, and one that nobody has
        }
        const can_frame_t f = numbered(id, id);
        others.send(&f, 1);
        if (motor_node_accepts(2, static_cast<std::uint16_t>(id))) {
            expected.push_back(id);
        }
        PeriodFrames received{};
        node.receive_available(received);
        for (std::size_t i = 0; i < received.count; ++i) {
            passed.push_back(received.frames[i].id);
        }
    }
    CHECK(passed == expected);
}
