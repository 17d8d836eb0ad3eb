#include "link/can_load.h"

#include <array>
#include <cstdint>

namespace hpmc {
namespace {

constexpr int kTailBits = 1 + 2 + 7 + 3; // CRC delimiter, acknowledge, end of frame, intermission
constexpr int kStuffRun = 5;

/// Start of frame to CRC: 1 + 11 + 3 + 4 + 64 + 15 bits at most.
class BitSequence {
  public:
    void append(std::uint32_t value, int count) {
        for (int i = count - 1; i >= 0; --i) {
            bits_[static_cast<std::size_t>(length_++)] = static_cast<std::uint8_t>(value >> i & 1U);
        }
    }

    std::uint32_t crc15() const {
        std::uint32_t crc = 0;
        for (int i = 0; i < length_; ++i) {
            const std::uint32_t next = bits_[static_cast<std::size_t>(i)] ^ (crc >> 14 & 1U);
            crc = crc << 1 & 0x7FFFU;
            if (next != 0U) {
                crc ^= 0x4599U;
            }
        }
        return crc;
    }

    int stuffed_length() const {
        int total = 0;
        int run = 0;
        int last = -1;
        for (int i = 0; i < length_; ++i) {
            const int bit = bits_[static_cast<std::size_t>(i)];
            run = bit == last ? run + 1 : 1;
            last = bit;
            ++total;
            if (run == kStuffRun) {
                ++total;
                last = 1 - bit;
                run = 1;
            }
        }
        return total;
    }

  private:
    std::array<std::uint8_t, 98> bits_{};
    int length_ = 0;
};

} // namespace

int can_bits_exact(const can_frame_t &frame) {
    BitSequence bits;
    bits.append(0, 1);
    bits.append(frame.id, 11);
    bits.append(0, 3); // data frame, 11-bit identifier, reserved bit
    bits.append(frame.len, 4);
    for (int i = 0; i < frame.len; ++i) {
        bits.append(frame.data[i], 8);
    }
    bits.append(bits.crc15(), 15);
    return bits.stuffed_length() + kTailBits;
}

} // namespace hpmc
