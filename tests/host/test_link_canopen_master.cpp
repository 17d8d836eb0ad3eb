#include <doctest/doctest.h>

#include <algorithm>
#include <vector>

#include "link/canopen_master.h"
#include "node_bench.h"

using namespace hpmc;
using test::frame;

namespace {

using Frames = std::vector<can_frame_t>;

/// The master alone; the nodes' answers are written by hand.
struct MasterBench {
    explicit MasterBench(std::size_t writes_per_node = 1) : master(config(writes_per_node)) {}

    static CanopenMasterConfig config(std::size_t writes_per_node) {
        CanopenMasterConfig result;
        const std::vector<SdoWrite> objects{{0x1017, 0, 2, 100}, {0x2100, 4, 4, 0x12345678}};
        for (auto &writes : result.configuration) {
            writes.assign(objects.begin(),
                          objects.begin() + static_cast<std::ptrdiff_t>(writes_per_node));
        }
        return result;
    }

    /// One period: the answers come in, the next frames go out.
    const Frames &period(const Frames &answers = {}) {
        if (!first) {
            fault = master.receive(answers.data(), answers.size());
        }
        first = false;
        std::array<can_frame_t, CanopenMaster::kFramesMax> out;
        const std::size_t count = master.compose(commands, out);
        sent.assign(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(count));
        return sent;
    }

    const can_frame_t *find(unsigned id) const {
        const auto found =
            std::find_if(sent.begin(), sent.end(), [id](const auto &f) { return f.id == id; });
        return found == sent.end() ? nullptr : &*found;
    }

    void boot() {
        period();
        period();
        period({frame(0x701, {0}), frame(0x702, {0}), frame(0x703, {0})});
    }

    static Frames tpdo1(unsigned statusword) {
        Frames answers;
        for (unsigned node = 1; node <= kJoints; ++node) {
            answers.push_back(
                frame(0x180 + node, {node, 0, 0, 0, 0, 0, statusword & 0xFFU, statusword >> 8U}));
        }
        return answers;
    }

    void configure() {
        boot();
        Frames answers;
        for (int i = 0; i < 20 && master.stage() != MasterStage::enable; ++i) {
            answers.clear();
            for (const can_frame_t &f : sent) {
                if ((f.id & 0x780) == 0x600) {
                    answers.push_back(
                        frame(f.id - 0x80U, {0x60, f.data[1], f.data[2], f.data[3], 0, 0, 0, 0}));
                }
            }
            period(answers);
        }
    }

    void enable() {
        configure();
        for (const unsigned statusword : {0x0250U, 0x0231U, 0x0233U, 0x0237U}) {
            for (int i = 0; i < 4; ++i) {
                period(tpdo1(statusword));
            }
        }
    }

    CanopenMaster master;
    std::array<JointCommand, kJoints> commands{};
    Frames sent;
    std::string fault;
    bool first = true;
};

std::vector<unsigned> bytes(const can_frame_t &f) {
    return {f.data, f.data + f.len};
}

} // namespace

TEST_CASE("the first frame resets all nodes; nothing else goes out until all have booted") {
    MasterBench bench;
    bench.period();
    REQUIRE(bench.sent.size() == 1);
    CHECK(bench.sent[0].id == 0x000);
    CHECK(bytes(bench.sent[0]) == std::vector<unsigned>{0x81, 0});
    // With a joint loop of 5 kHz a boot-up may come in the very period of the reset.
    bench.period({frame(0x701, {0}), frame(0x702, {0})});
    for (int i = 0; i < 20; ++i) {
        bench.period();
        CHECK(bench.master.stage() == MasterStage::boot);
        CHECK(bench.find(0x601) == nullptr);
    }
    bench.period({frame(0x703, {5})}); // a heartbeat is no boot-up
    CHECK(bench.master.stage() == MasterStage::boot);
    bench.period({frame(0x703, {0})});
    CHECK(bench.master.stage() == MasterStage::configure);
    CHECK(bench.find(0x601) != nullptr);
}

TEST_CASE("SDO: expedited downloads with their size, one frame a period, node after node") {
    MasterBench bench(2);
    bench.boot();
    REQUIRE(bench.master.stage() == MasterStage::configure);
    const auto answer = [](unsigned node, unsigned index, unsigned subindex) {
        return frame(0x580 + node, {0x60, index & 0xFFU, index >> 8U, subindex, 0, 0, 0, 0});
    };
    REQUIRE(bench.find(0x601) != nullptr);
    CHECK(bytes(*bench.find(0x601)) == std::vector<unsigned>{0x2B, 0x17, 0x10, 0, 100, 0, 0, 0});
    bench.period();
    CHECK(bench.find(0x602) != nullptr);
    bench.period();
    CHECK(bench.find(0x603) != nullptr);
    bench.period();
    CHECK(std::none_of(bench.sent.begin(), bench.sent.end(),
                       [](const auto &f) { return (f.id & 0x780) == 0x600; }));
    // An answer about another object, or of another length, is not the one waited for.
    bench.period({answer(1, 0x1018, 0), frame(0x582, {0x60, 0x17, 0x10, 0})});
    CHECK(bench.find(0x601) == nullptr);
    bench.period({answer(1, 0x1017, 0)});
    REQUIRE(bench.find(0x601) != nullptr);
    CHECK(bytes(*bench.find(0x601)) ==
          std::vector<unsigned>{0x23, 0x00, 0x21, 0x04, 0x78, 0x56, 0x34, 0x12});
    bench.period({answer(1, 0x2100, 4), answer(2, 0x1017, 0), answer(3, 0x1017, 0)});
    bench.period();
    bench.period({answer(2, 0x2100, 4), answer(3, 0x2100, 4)});
    REQUIRE(bench.master.stage() == MasterStage::start);
    bench.period();
    REQUIRE(bench.sent.size() == 1);
    CHECK(bytes(bench.sent[0]) == std::vector<unsigned>{0x01, 0});
    CHECK(bench.fault.empty());
}

TEST_CASE("an SDO abort and a missing answer name node and object") {
    MasterBench bench;
    bench.boot();
    SUBCASE("abort") {
        bench.period({frame(0x581, {0x80, 0x17, 0x10, 0x00, 0x02, 0x00, 0x01, 0x06})});
        CHECK(bench.fault ==
              "motor node 1: refused object 1017h:00 = 100 with SDO abort 06010002h");
    }
    SUBCASE("silence") {
        int periods = 0;
        while (bench.fault.empty() && periods < 100) {
            bench.period();
            ++periods;
        }
        CHECK(bench.fault == "motor node 1: did not answer an SDO request within 50 periods");
        CHECK(periods == 50);
    }
}

TEST_CASE("the drive is led on by its statusword: shutdown, switch on, enable operation") {
    MasterBench bench;
    bench.configure();
    REQUIRE(bench.master.stage() == MasterStage::enable);
    const auto controlwords = [&bench](unsigned statusword) {
        std::vector<unsigned> words;
        for (int i = 0; i < 4; ++i) {
            bench.period(MasterBench::tpdo1(statusword));
            for (const can_frame_t &f : bench.sent) {
                if ((f.id & 0x780) == 0x300) {
                    CHECK(f.len == 3);
                    CHECK(f.data[2] == 0xFF); // mode -1
                    words.push_back(static_cast<unsigned>(f.data[0] | f.data[1] << 8));
                }
            }
        }
        return words;
    };
    // Each node is told once: one frame a period, then silence until the state changes.
    CHECK(controlwords(0x0250) == std::vector<unsigned>{6, 6, 6});
    CHECK(controlwords(0x0231) == std::vector<unsigned>{7, 7, 7});
    CHECK(controlwords(0x0233) == std::vector<unsigned>{0xF, 0xF, 0xF});
    CHECK(controlwords(0x0237).empty());
    CHECK(bench.master.stage() == MasterStage::enabled);
    CHECK(bench.fault.empty());
}

TEST_CASE("a controlword that shows no effect is repeated after 10 periods") {
    MasterBench bench;
    bench.configure();
    std::vector<int> at;
    for (int i = 0; i < 40; ++i) {
        bench.period(MasterBench::tpdo1(0x0250));
        if (bench.find(0x301) != nullptr) {
            at.push_back(i);
        }
    }
    REQUIRE(at.size() >= 3);
    CHECK(at[1] - at[0] >= 10);
    CHECK(at[1] - at[0] <= 13);
}

TEST_CASE("RPDO1: position, torque and maximum torque in little-endian") {
    MasterBench bench;
    bench.enable();
    bench.commands[1] = {-2, -1000, 32767};
    bench.period(MasterBench::tpdo1(0x0237));
    REQUIRE(bench.find(0x202) != nullptr);
    CHECK(bytes(*bench.find(0x202)) ==
          std::vector<unsigned>{0xFE, 0xFF, 0xFF, 0xFF, 0x18, 0xFC, 0xFF, 0x7F});
}

TEST_CASE("the SYNC counter goes from 1 to 240 and round, and begins anew with a restart") {
    MasterBench bench;
    bench.enable();
    unsigned last = 0;
    for (int i = 0; i < 600; ++i) {
        bench.period(MasterBench::tpdo1(0x0237));
        REQUIRE(bench.find(0x080) != nullptr);
        const unsigned counter = bench.find(0x080)->data[0];
        CHECK(counter >= 1);
        CHECK(counter <= 240);
        if (last != 0) {
            CHECK(counter == last % 240 + 1);
        }
        last = counter;
    }
    bench.master.restart();
    bench.first = true;
    bench.configure();
    bench.period(MasterBench::tpdo1(0x0250));
    CHECK(bench.find(0x080)->data[0] <= 2);
}

TEST_CASE("the host's heartbeat comes every 100 periods") {
    MasterBench bench;
    bench.enable();
    std::vector<int> at;
    for (int i = 0; i < 450; ++i) {
        bench.period(MasterBench::tpdo1(0x0237));
        if (const can_frame_t *heartbeat = bench.find(0x77F)) {
            CHECK(bytes(*heartbeat) == std::vector<unsigned>{0x05});
            at.push_back(i);
        }
    }
    REQUIRE(at.size() >= 4);
    for (std::size_t i = 1; i < at.size(); ++i) {
        CHECK(at[i] - at[i - 1] == 100);
    }
}

TEST_CASE("TPDO1, TPDO2, EMCY and heartbeat are taken in; frames of a wrong length are not") {
    MasterBench bench;
    bench.enable();
    Frames answers = MasterBench::tpdo1(0x0237);
    answers[1] = frame(0x182, {0xFE, 0xFF, 0xFF, 0xFF, 0x18, 0xFC, 0x37, 0x42});
    answers.push_back(frame(0x282, {0xFF, 0x01, 0x10, 0x03, 0x00, 0x04, 0x01}));
    answers.push_back(frame(0x702, {0x05}));
    bench.period(answers);
    const NodeView &node = bench.master.node(1);
    CHECK(node.position_inc == -2);
    CHECK(node.torque_mNm == -1000);
    CHECK(node.statusword == 0x4237);
    CHECK(node.mode_display == -1);
    CHECK(node.limit_reasons == 0x1001);
    CHECK(node.missed_sync == 3);
    CHECK(node.temperature_dC == 260);
    CHECK(node.nmt_state == 5);
    CHECK(bench.master.news(1));
    CHECK_FALSE(bench.master.news(0));
    answers = MasterBench::tpdo1(0x0237);
    answers[1] = frame(0x182, {1, 2, 3, 4, 5, 6, 0x37});
    answers.push_back(frame(0x282, {1, 2, 3, 4, 5, 6}));
    answers.push_back(frame(0x082, {0x50, 0x82, 0x11}));
    answers.push_back(frame(0x184, {9, 9, 9, 9, 9, 9, 9, 9})); // no such node
    answers.push_back(frame(0x200, {9}));
    bench.period(answers);
    CHECK(node.position_inc == -2);
    CHECK(node.temperature_dC == 260);
    CHECK(node.emcy_count == 0);
    CHECK(bench.fault.empty());
}

TEST_CASE("stop: quick stop to all at once, off when at rest, NMT stop, then silence") {
    MasterBench bench;
    bench.enable();
    bench.master.stop();
    bench.period(MasterBench::tpdo1(0x0237));
    CHECK(bench.sent.size() == 4);
    for (unsigned node = 1; node <= kJoints; ++node) {
        REQUIRE(bench.find(0x300 + node) != nullptr);
        CHECK(bytes(*bench.find(0x300 + node)) == std::vector<unsigned>{2, 0, 0});
    }
    // Quick stop active: waited for, with SYNC going on, so that the ramp can be watched.
    for (int i = 0; i < 100; ++i) {
        bench.period(MasterBench::tpdo1(0x0217));
        CHECK(bench.find(0x301) == nullptr);
        CHECK(bench.find(0x080) != nullptr);
    }
    for (unsigned node = 1; node <= kJoints; ++node) {
        bench.period(MasterBench::tpdo1(0x0250));
        REQUIRE(bench.find(0x300 + node) != nullptr);
        CHECK(bytes(*bench.find(0x300 + node)) == std::vector<unsigned>{0, 0, 0});
    }
    REQUIRE(bench.master.stage() == MasterStage::stopped);
    bench.period();
    REQUIRE(bench.find(0x000) != nullptr);
    CHECK(bytes(*bench.find(0x000)) == std::vector<unsigned>{2, 0});
    for (int i = 0; i < 10; ++i) {
        bench.period();
        CHECK(bench.find(0x000) == nullptr);
        CHECK(bench.find(0x080) == nullptr);
    }
    CHECK(bench.fault.empty());
}

TEST_CASE("stop does not wait for ever for a drive that stays in quick stop") {
    MasterBench bench;
    bench.enable();
    bench.master.stop();
    int periods = 0;
    while (bench.master.stage() != MasterStage::stopped && periods < 1000) {
        bench.period(MasterBench::tpdo1(0x0217));
        ++periods;
    }
    CHECK(periods > 200);
    CHECK(periods < 210);
}

TEST_CASE("stop before the nodes are started: NMT stop alone") {
    MasterBench bench;
    bench.boot();
    bench.master.stop();
    bench.period();
    CHECK(bytes(*bench.find(0x000)) == std::vector<unsigned>{2, 0});
    CHECK(bench.find(0x301) == nullptr);
}
