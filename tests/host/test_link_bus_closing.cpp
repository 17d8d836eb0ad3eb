#include <doctest/doctest.h>

#include <set>
#include <vector>

#include "link/bus_closing.h"
#include "node_bench.h"

extern "C" {
#include "port/posix/node_filters.h"
}

using namespace hpmc;
using test::frame;

namespace {

std::vector<unsigned> ids(const PeriodFrames &frames) {
    std::vector<unsigned> result;
    for (std::size_t i = 0; i < frames.count; ++i) {
        result.push_back(frames.frames[i].id);
    }
    return result;
}

PeriodFrames period_of(const std::vector<unsigned> &identifiers) {
    PeriodFrames frames{};
    for (const unsigned id : identifiers) {
        const can_frame_t f = frame(id, {});
        frames.append(&f, 1);
    }
    return frames;
}

} // namespace

TEST_CASE("who sent a frame is seen from its identifier") {
    for (const unsigned id : {0x081U, 0x181U, 0x281U, 0x581U, 0x701U}) {
        CAPTURE(id);
        CHECK(sender_of(frame(id, {})) == 1);
        CHECK(sender_of(frame(id + 2, {})) == 3);
    }
    for (const unsigned id : {0x000U, 0x080U, 0x201U, 0x301U, 0x601U, 0x77FU, 0x7E5U}) {
        CAPTURE(id);
        CHECK(sender_of(frame(id, {})) == 0);
    }
    CHECK(sender_of(frame(0x502, {})) == 127);
}

TEST_CASE("a node gets what is for it or for all, and nothing of its own") {
    const PeriodFrames period = period_of({0x000, 0x080, 0x081, 0x082, 0x083, 0x181, 0x182, 0x201,
                                           0x202, 0x203, 0x281, 0x301, 0x302, 0x501, 0x502, 0x581,
                                           0x582, 0x601, 0x602, 0x701, 0x702, 0x703, 0x77F, 0x7E5});
    PeriodFrames inbox{};
    deliver(2, period, inbox);
    CHECK(ids(inbox) == std::vector<unsigned>{0x000, 0x080, 0x081, 0x083, 0x202, 0x302, 0x502,
                                              0x602, 0x701, 0x703, 0x77F, 0x7E5});
}

TEST_CASE("frames are sorted as arbitration would have it, equal ones keep their order") {
    PeriodFrames frames{};
    for (const unsigned byte : {1U, 2U, 3U}) {
        for (const unsigned id : {0x703U, 0x081U, 0x182U}) {
            const can_frame_t f = frame(id, {byte});
            frames.append(&f, 1);
        }
    }
    frames.sort_by_identifier();
    CHECK(ids(frames) ==
          std::vector<unsigned>{0x081, 0x081, 0x081, 0x182, 0x182, 0x182, 0x703, 0x703, 0x703});
    for (std::size_t i = 0; i < frames.count; ++i) {
        CHECK(frames.frames[i].data[0] == i % 3 + 1);
    }
}

TEST_CASE("frames beyond the room are counted, not written") {
    PeriodFrames frames{};
    const std::vector<can_frame_t> many(40, frame(0x123, {1}));
    frames.append(many.data(), many.size());
    CHECK(frames.dropped == 0);
    frames.append(many.data(), many.size());
    CHECK(frames.count == PeriodFrames::kMax);
    CHECK(frames.dropped == 80 - PeriodFrames::kMax);
}

TEST_CASE("the kernel's filters of a node are its accept rule") {
    for (unsigned node_id = 1; node_id <= 127; ++node_id) {
        can_socket_filter_t filters[NODE_FILTERS_COUNT];
        node_filters(static_cast<std::uint8_t>(node_id), filters);
        const std::set<unsigned> excepted{0x700}; // no node has it
        std::size_t accepted = 0;
        for (unsigned id = 0; id <= 0x7FF; ++id) {
            bool passes = false;
            for (const can_socket_filter_t &filter : filters) {
                passes = passes || (id & filter.mask) == (filter.match & filter.mask);
            }
            const bool accepts = motor_node_accepts(static_cast<std::uint8_t>(node_id),
                                                    static_cast<std::uint16_t>(id));
            if (excepted.count(id) == 0 && passes != accepts) {
                CAPTURE(node_id);
                CAPTURE(id);
                CHECK(passes == accepts);
            }
            accepted += accepts ? 1 : 0;
        }
        CHECK(accepted > 200); // 127 emergencies, 127 heartbeats and a few more
        CHECK(accepted < 300);
    }
}
