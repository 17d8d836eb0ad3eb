#include <doctest/doctest.h>

#include <array>
#include <filesystem>
#include <lcm/lcm.h>
#include <memory>
#include <string>
#include <unistd.h>
#include <vector>

#include "apps/sil_rig.h"
#include "node_bench.h"
#include "slcan_peer.h"

using namespace hpmc;
using test::NodeOnLine;
using test::ScriptedPeer;

namespace {

const std::vector<std::string> kShort{"experiment.period_s=0.2", "rig.sensors=injected"};

struct NodesOnLines {
    std::array<NodeOnLine, kJoints> peers{NodeOnLine(1), NodeOnLine(2), NodeOnLine(3)};

    RigNodes connect() {
        RigNodes nodes;
        for (std::size_t joint = 0; joint < kJoints; ++joint) {
            nodes[joint] = std::make_unique<EmulatedNode>(static_cast<std::uint8_t>(joint + 1),
                                                          peers[joint].link_fd());
        }
        return nodes;
    }
};

class LogFile {
  public:
    LogFile() {
        char name[] = "/tmp/hpmc-log-XXXXXX";
        close(mkstemp(name));
        path = name;
    }
    ~LogFile() { std::filesystem::remove(path); }
    LogFile(const LogFile &) = delete;
    LogFile &operator=(const LogFile &) = delete;

    std::vector<std::string> messages(const std::string &channel) const {
        std::vector<std::string> found;
        lcm_eventlog_t *log = lcm_eventlog_create(path.c_str(), "r");
        while (lcm_eventlog_event_t *event = lcm_eventlog_read_next_event(log)) {
            if (channel == event->channel) {
                found.emplace_back(static_cast<const char *>(event->data),
                                   static_cast<std::size_t>(event->datalen));
            }
            lcm_eventlog_free_event(event);
        }
        lcm_eventlog_destroy(log);
        return found;
    }

    std::string path;
};

SilOptions logged(const LogFile &file) {
    SilOptions options;
    options.log = file.path;
    return options;
}

void run(SilRig &rig) {
    for (std::int64_t period = rig.first_period(); period < rig.last_period(); ++period) {
        REQUIRE(rig.step(period));
    }
    CHECK(rig.fault().empty());
    CHECK(rig.frames_lost() == 0);
}

} // namespace

TEST_CASE("nodes at the ends of SLCAN lines give the run of nodes in this process") {
    const RunConfig config = test::clock_config(kShort);
    const LogFile on_lines;
    const LogFile native;
    NodesOnLines nodes;
    {
        SilRig rig(logged(on_lines), config, nodes.connect(), "emulated");
        run(rig);
    }
    {
        SilRig rig(logged(native), config);
        run(rig);
    }
    CHECK(native.messages("ARM_STATE").size() == 4450);
    for (const char *channel : {"ARM_STATE", "HAND_WRENCH", "BUS_CLOSED", "CAN_FRAMES",
                                "HPMC_STATE", "JOINT_TORQUE_1", "JOINT_TORQUE_3"}) {
        CHECK_MESSAGE(on_lines.messages(channel) == native.messages(channel), channel);
    }
}

TEST_CASE("a node that is not the one expected is named before the run") {
    NodeOnLine other(3);
    CHECK_THROWS_WITH_AS(EmulatedNode(2, other.link_fd()),
                         "motor node 2: no answer to an SDO request; is it node-id 2?", LinkError);
}

TEST_CASE("a node that refuses the stepped time base") {
    ScriptedPeer refusing;
    refusing.say("V0100\rN0001\r\r\rt5828602F000000000000\r\rt582880012F0022000008\r\r");
    CHECK_THROWS_WITH_AS(EmulatedNode(2, refusing.link_fd()),
                         "motor node 2: refused object 2F01h = 1 with SDO abort 08000022h",
                         LinkError);
}
