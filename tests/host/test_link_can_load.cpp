#include <doctest/doctest.h>

#include <random>
#include <utility>
#include <vector>

#include "link/can_load.h"
#include "node_bench.h"

using namespace hpmc;
using test::frame;

TEST_CASE("worst case: the figures of the bus budget") {
    CHECK(can_bits_worst(0) == 55);
    CHECK(can_bits_worst(1) == 65);
    CHECK(can_bits_worst(8) == 135);
}

TEST_CASE("exact bits of known frames") {
    // All zeros: 19 bits and a CRC of 15 zeros, a stuff bit after each 5 of the 34, and 13 behind.
    CHECK(can_bits_exact(frame(0x000, {})) == 34 + 6 + 13);
    // Counted by a polynomial division and a stuffer that share nothing with this code.
    const std::vector<std::pair<can_frame_t, int>> known{
        {frame(0x080, {0x01}), 59},
        {frame(0x7FF, {}), 50},
        {frame(0x7FF, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}), 126},
        {frame(0x555, {0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55}), 112},
        {frame(0x000, {0, 0, 0, 0, 0, 0, 0, 0}), 127},
        {frame(0x201, {0x34, 0x12, 0x00, 0x00, 0xE8, 0x03, 0x88, 0x13}), 120},
        {frame(0x183, {0xFF, 0xFF, 0xFF, 0xFF, 0x18, 0xFC, 0x37, 0x46}), 120},
        {frame(0x77F, {0x05}), 59},
        {frame(0x078, {0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C}), 131}};
    for (const auto &[known_frame, bits] : known) {
        CAPTURE(known_frame.id);
        CHECK(can_bits_exact(known_frame) == bits);
    }
}

TEST_CASE("no frame takes more than the worst case or less than its bits without stuffing") {
    std::mt19937 random(1);
    for (int i = 0; i < 20000; ++i) {
        can_frame_t f{};
        f.id = static_cast<std::uint16_t>(random() & 0x7FF);
        f.len = static_cast<std::uint8_t>(random() % 9);
        // Long runs of equal bits are what gets stuffed.
        const auto pattern = random();
        for (int byte = 0; byte < f.len; ++byte) {
            f.data[byte] =
                static_cast<std::uint8_t>(random() % 2 ? pattern >> byte : random() * 255);
        }
        CHECK(can_bits_exact(f) <= can_bits_worst(f.len));
        CHECK(can_bits_exact(f) >= 47 + 8 * f.len);
    }
}
