/**
 * How much of a classical CAN bus frames take: bits on the wire, worst case and exact.
 *
 * Source: ISO 11898-1 (frame fields, bit stuffing from start of frame to the end of the CRC); three
 * bits of intermission are counted with each frame.
 */
#pragma once

#include "canopen/can_frame.h"

namespace hpmc {

/// Bits of a data frame with `len` (0..8) bytes when bit stuffing is at its worst.
constexpr int can_bits_worst(int len) {
    return 47 + 8 * len + (34 + 8 * len - 1) / 4;
}

/// Bits of exactly this data frame, stuffed bits and CRC included.
int can_bits_exact(const can_frame_t &frame);

} // namespace hpmc
