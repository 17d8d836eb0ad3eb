/**
 * The other ends of SLCAN lines, for tests. No write can meet a line that is closed already: a peer
 * of a script writes before the link reads, and a node's thread takes any error for the end.
 */
#pragma once

#include <cstdint>
#include <string>
#include <thread>

extern "C" {
#include "port/slcan/slcan_node.h"
}

namespace test {

/// An end that says what the test tells it to, before the link looks.
class ScriptedPeer {
  public:
    ScriptedPeer();
    ~ScriptedPeer();
    ScriptedPeer(const ScriptedPeer &) = delete;
    ScriptedPeer &operator=(const ScriptedPeer &) = delete;

    int link_fd() const { return fds_[0]; } ///< for the link, which closes it
    void say(const std::string &text);
    std::string heard();    ///< all that the link has sent since the last call
    void hear(char wanted); ///< waits until the link has sent it; all up to there is gone
    void hang_up();

  private:
    int fds_[2]{-1, -1};
};

/// The firmware behind a line, in a thread of its own, as a board's port runs it.
class NodeOnLine {
  public:
    explicit NodeOnLine(std::uint8_t node_id);
    ~NodeOnLine(); ///< also ends the line, if the link has not
    NodeOnLine(const NodeOnLine &) = delete;
    NodeOnLine &operator=(const NodeOnLine &) = delete;

    int link_fd() const { return fds_[0]; } ///< for the link, which closes it

  private:
    void serve();
    void step(std::uint32_t elapsed_us);
    void send();

    int fds_[2]{-1, -1};
    motor_node_config_t config_{};
    motor_node_t node_{};
    slcan_node_t slcan_{};
    slcan_node_text_t text_{};
    std::thread thread_;
};

} // namespace test
