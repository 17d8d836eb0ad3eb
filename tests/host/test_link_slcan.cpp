#include <doctest/doctest.h>

#include <arpa/inet.h>
#include <cstdlib>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <termios.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include "link/lcm_link.h"
#include "link/slcan_link.h"
#include "node_bench.h"
#include "slcan_peer.h"

using namespace hpmc;
using test::frame;
using test::ScriptedPeer;

namespace {

constexpr int kShort_ms = 50;

/// A link whose channel is open, and its peer.
struct OpenLine {
    explicit OpenLine(int timeout_ms = SlcanLink::kTimeout_ms)
        : link(peer.link_fd(), "node", timeout_ms) {
        peer.say("V0100\rN0001\r\r\r");
        link.open_node();
        peer.heard();
    }

    ScriptedPeer peer;
    SlcanLink link;
    PeriodFrames received;
};

/// A TCP socket on a port that the system chose; listening only when asked to.
struct Listener {
    explicit Listener(bool listening) : fd(socket(AF_INET, SOCK_STREAM, 0)) {
        sockaddr_in address{};
        socklen_t size = sizeof address;
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        REQUIRE(bind(fd, reinterpret_cast<sockaddr *>(&address), size) == 0);
        REQUIRE(getsockname(fd, reinterpret_cast<sockaddr *>(&address), &size) == 0);
        if (listening) {
            REQUIRE(listen(fd, 1) == 0);
        }
        name = "slcan:tcp:127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    }
    ~Listener() { close(fd); }

    int fd;
    std::string name;
};

} // namespace

TEST_CASE("SLCAN: opening skips what comes from before, and a refused C") {
    ScriptedPeer peer;
    SlcanLink link(peer.link_fd(), "node");
    peer.say("23\r\a\xFF\r\r\at1810\r\aV0100\rN0001\r\r\r");
    link.open_node();
    CHECK(peer.heard() == "\r\rC\rV\rN\rS8\rO\r");
    CHECK(link.stats().refused == 0);
}

TEST_CASE("SLCAN: a board that is still starting is asked again") {
    ScriptedPeer peer;
    SlcanLink link(peer.link_fd(), "node");
    std::thread board([&peer] {
        peer.hear('V'); // lost
        peer.hear('V');
        peer.say("\aV0100\r\aV0100\r"); // this, and one that came just in time
        peer.hear('N');
        peer.say("\aV0100\rN0001\r\r\r");
    });
    link.open_node();
    board.join();
    CHECK(link.stats().garbled == 0);
}

TEST_CASE("SLCAN: an adapter is opened without an answer, and what it says is not missed") {
    ScriptedPeer peer;
    SlcanLink link(peer.link_fd(), "adapter", kShort_ms);
    peer.say("\ar1810\r"); // C refused, a frame from before
    link.open_adapter();
    CHECK(peer.heard() == "\r\rC\rS8\rO\r");
    PeriodFrames received;
    const can_frame_t one = frame(0x201, {1});
    link.send(&one, 1);
    link.send(&one, 1);
    peer.say("\rz\rz\rt1810\r");
    link.receive(1, received);
    CHECK(received.frames[0].id == 0x181);
    peer.say("\a");
    CHECK_THROWS_WITH_AS(link.receive_available(received), "adapter: refused a line", LinkError);
}

TEST_CASE("SLCAN: an end that does not speak it is an error within the time-out") {
    ScriptedPeer peer;
    SlcanLink link(peer.link_fd(), "node", kShort_ms);
    peer.say("login: \r");
    CHECK_THROWS_WITH_AS(link.open_node(),
                         "node: did not answer within 50 ms; is there a node that speaks SLCAN?",
                         LinkError);
}

TEST_CASE("SLCAN: a node answers after its frames, an adapter with z") {
    OpenLine line;
    const can_frame_t frames[2] = {frame(0x080, {0xA5}), frame(0x601, {1, 2, 3, 4, 5, 6, 7, 0xF8})};
    line.link.send(frames, 2);
    CHECK(line.peer.heard() == "t0801A5\rt601801020304050607F8\r");
    line.peer.say("t1812BEEF\r\r\r");
    line.link.await_answers(line.received);
    REQUIRE(line.received.count == 1);
    CHECK(line.received.frames[0].id == 0x181);
    CHECK(line.received.frames[0].len == 2);
    CHECK(line.received.frames[0].data[1] == 0xEF);

    line.link.send(frames, 2);
    line.peer.say("z\rt7011050\r"); // the second line is none
    CHECK_THROWS_WITH_AS(line.link.await_answers(line.received),
                         "node: sent a line that is none: \"t7011050\"", LinkError);
}

TEST_CASE("SLCAN: answers and frames come in pieces of any size") {
    for (const std::size_t size : {1U, 2U, 3U, 7U}) {
        OpenLine line;
        const can_frame_t one = frame(0x201, {1, 2, 3});
        const std::string text = "t181801020304050607F8\rz\r\r";
        line.link.send(&one, 1);
        line.link.send(&one, 1);
        for (std::size_t at = 0; at < text.size(); at += size) {
            line.peer.say(text.substr(at, size));
            if (at + size < text.size()) {
                line.link.receive_available(line.received);
            }
        }
        line.link.await_answers(line.received);
        CHECK(line.received.count == 1);
    }
}

TEST_CASE("SLCAN: what comes after the last answer stays for the next turn") {
    OpenLine line;
    const can_frame_t one = frame(0x201, {1});
    line.link.send(&one, 1);
    line.peer.say("\rt70110");
    line.link.await_answers(line.received);
    CHECK(line.received.count == 0);
    line.peer.say("5\r");
    line.link.receive(1, line.received);
    CHECK(line.received.frames[0].data[0] == 5);
}

TEST_CASE("SLCAN: a refused line, counted") {
    OpenLine line;
    const can_frame_t one = frame(0x201, {1});
    line.link.send(&one, 1);
    line.peer.say("\a");
    CHECK_THROWS_WITH_AS(line.link.await_answers(line.received), "node: refused a line", LinkError);
    CHECK(line.link.stats().refused == 1);
}

TEST_CASE("SLCAN: garbled lines, counted") {
    for (const char *wrong : {"t18\x80\r", "t1812BEE\r", "t181812345678901234567\r", "q\r", "zz\r",
                              "t2018001122334455667788\r"}) {
        OpenLine line;
        const can_frame_t one = frame(0x201, {1});
        line.link.send(&one, 1);
        line.peer.say(wrong);
        CHECK_THROWS_AS(line.link.await_answers(line.received), LinkError);
        CHECK(line.link.stats().garbled == 1);
    }
}

TEST_CASE("SLCAN: more answers than lines") {
    OpenLine line;
    line.peer.say("\r");
    CHECK_THROWS_WITH_AS(line.link.receive_available(line.received),
                         "node: answered more lines than it was sent", LinkError);
}

TEST_CASE("SLCAN: a silent end is an error within the time-out") {
    OpenLine line(kShort_ms);
    const can_frame_t two[2] = {frame(0x201, {1}), frame(0x202, {1})};
    line.link.send(two, 2);
    line.peer.say("\r");
    CHECK_THROWS_WITH_AS(line.link.await_answers(line.received),
                         "node: left 1 lines unanswered for 50 ms", LinkError);
    CHECK_THROWS_WITH_AS(line.link.receive(3, line.received), "node: 3 of 3 frames were lost",
                         LinkError);
}

TEST_CASE("SLCAN: an end that does not read is an error within the time-out") {
    OpenLine line(kShort_ms);
    const std::vector<can_frame_t> many(PeriodFrames::kMax, frame(0x201, {1, 2, 3, 4, 5, 6, 7, 8}));
    const auto flood = [&] {
        for (int i = 0; i < 100000; ++i) { // more than any buffer holds
            line.link.send(many.data(), many.size());
        }
    };
    CHECK_THROWS_WITH_AS(flood(), "node: took nothing for 50 ms", LinkError);
}

TEST_CASE("SLCAN: a line that the other end closes") {
    OpenLine line;
    const can_frame_t one = frame(0x201, {1});
    line.link.send(&one, 1);
    line.peer.heard();
    line.peer.hang_up();
    CHECK_THROWS_WITH_AS(line.link.await_answers(line.received), "node: the line was closed",
                         LinkError);
    CHECK_THROWS_WITH_AS(line.link.send(&one, 1), "node: cannot send: Broken pipe", LinkError);
}

TEST_CASE("SLCAN: other frames of an adapter's bus are counted and left out") {
    OpenLine line;
    line.peer.say("T000001231AA\rr1810\rR000001230\rt7F10\r");
    line.link.receive(1, line.received);
    CHECK(line.received.frames[0].id == 0x7F1);
    CHECK(line.link.stats().ignored == 3);
    CHECK(line.link.stats().frames_received == 1);
}

TEST_CASE("SLCAN: the channel is closed with the link") {
    ScriptedPeer peer;
    {
        SlcanLink link(peer.link_fd(), "node");
        peer.say("V0100\rN0001\r\r\r");
        link.open_node();
        peer.heard();
    }
    CHECK(peer.heard() == "\rC\r");
}

TEST_CASE("SLCAN: over TCP") {
    const Listener listener(true);
    SlcanLink link(listener.name, "node 1");
    const int peer = accept(listener.fd, nullptr, nullptr);
    REQUIRE(peer >= 0);
    const std::string answers = "V0100\rN0001\r\r\r";
    REQUIRE(write(peer, answers.data(), answers.size()) == static_cast<ssize_t>(answers.size()));
    link.open_node();
    close(peer);
}

TEST_CASE("SLCAN: nobody listens") {
    const Listener listener(false); // the port is taken, so that no one else can listen there
    CHECK_THROWS_WITH_AS(SlcanLink(listener.name, "node 1"),
                         ("node 1: " + listener.name + ": Connection refused").c_str(), LinkError);
}

TEST_CASE("SLCAN: over a serial device, which passes every byte as it is") {
    const int peer = posix_openpt(O_RDWR | O_NOCTTY);
    REQUIRE(peer >= 0);
    REQUIRE(grantpt(peer) == 0);
    REQUIRE(unlockpt(peer) == 0);
    const std::string device = ptsname(peer);
    {
        SlcanLink link("slcan:" + device + "@1000000", "node 1");
        const std::string answers = "\aV0100\rN0001\r\r\rt1810\r";
        REQUIRE(write(peer, answers.data(), answers.size()) ==
                static_cast<ssize_t>(answers.size()));
        link.open_node();
        PeriodFrames received;
        link.receive(1, received);
        CHECK(received.frames[0].id == 0x181);
        char heard[32];
        const ssize_t count = read(peer, heard, sizeof heard);
        CHECK(std::string(heard, static_cast<std::size_t>(count)).substr(0, 6) == "\r\rC\rV\r");
    }
    close(peer);
}

TEST_CASE("SLCAN: addresses that are none") {
    const std::vector<std::pair<std::string, std::string>> wrong{
        {"vcan0", "must be slcan:tcp:HOST:PORT or slcan:DEVICE"},
        {"slcan:", "must be slcan:tcp:HOST:PORT or slcan:DEVICE"},
        {"slcan:tcp:localhost", "must be slcan:tcp:HOST:PORT"},
        {"slcan:tcp::1", "must be slcan:tcp:HOST:PORT"},
        {"slcan:tcp:localhost:", "must be slcan:tcp:HOST:PORT"},
        {"slcan:/no/such/device", "No such file or directory"},
        {"slcan:/dev/null", "is not a serial device"},
        {"slcan:/dev/null@12345", "the baud rate must be one of 9600 to 2000000"}};
    for (const auto &[address, why] : wrong) {
        CHECK_THROWS_WITH_AS(SlcanLink(address, "node 1"),
                             ("node 1: " + address + ": " + why).c_str(), LinkError);
    }
}
