#include "slcan_peer.h"

#include <array>
#include <poll.h>
#include <stdexcept>
#include <sys/socket.h>
#include <unistd.h>

namespace test {
namespace {

void make_line(int (&fds)[2]) {
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds) != 0) {
        throw std::runtime_error("socketpair");
    }
}

} // namespace

ScriptedPeer::ScriptedPeer() {
    make_line(fds_);
}

ScriptedPeer::~ScriptedPeer() {
    hang_up();
}

void ScriptedPeer::say(const std::string &text) {
    if (::send(fds_[1], text.data(), text.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(text.size())) {
        throw std::runtime_error("the link has gone");
    }
}

std::string ScriptedPeer::heard() {
    std::string all;
    std::array<char, 4096> part;
    for (;;) {
        const ssize_t got = recv(fds_[1], part.data(), part.size(), MSG_DONTWAIT);
        if (got <= 0) {
            return all;
        }
        all.append(part.data(), static_cast<std::size_t>(got));
    }
}

void ScriptedPeer::hear(char wanted) {
    constexpr int kBound_ms = 30000;
    pollfd data{fds_[1], POLLIN, 0};
    char byte = '\0';
    while (byte != wanted && poll(&data, 1, kBound_ms) == 1 && recv(fds_[1], &byte, 1, 0) == 1) {
    }
}

void ScriptedPeer::hang_up() {
    if (fds_[1] >= 0) {
        close(fds_[1]);
        fds_[1] = -1;
    }
}

NodeOnLine::NodeOnLine(std::uint8_t node_id) {
    config_.node_id = node_id;
    config_.serial_number = node_id;
    config_.referenced = true;
    motor_node_init(&config_, &node_);
    make_line(fds_);
    thread_ = std::thread([this] { serve(); });
}

NodeOnLine::~NodeOnLine() {
    shutdown(fds_[1], SHUT_RDWR);
    thread_.join();
    close(fds_[1]);
}

void NodeOnLine::send() {
    (void)!::send(fds_[1], text_.text, text_.length, MSG_NOSIGNAL);
}

void NodeOnLine::step(std::uint32_t elapsed_us) {
    motor_node_input_t input{};
    motor_node_output_t output;
    input.elapsed_us = elapsed_us;
    input.temperature_dC = 250;
    slcan_node_input(&slcan_, &input);
    motor_node_step(&config_, &node_, &input, &output);
    if (output.reset_requested) {
        motor_node_restart(&config_, &node_);
    }
    slcan_node_output(&output, &slcan_, &text_);
    send();
}

void NodeOnLine::serve() {
    std::array<std::uint8_t, 4096> bytes;
    for (;;) {
        pollfd data{fds_[1], POLLIN, 0};
        if (poll(&data, 1, node_.od.time_base != 0 ? -1 : 1) == 0) {
            step(1000); // free-running
            continue;
        }
        const ssize_t count = recv(fds_[1], bytes.data(), bytes.size(), 0);
        if (count <= 0) {
            return;
        }
        for (ssize_t i = 0; i < count; ++i) {
            const bool due =
                slcan_node_receive(&node_, bytes[static_cast<std::size_t>(i)], &slcan_, &text_);
            send();
            if (due) {
                step(0);
            }
        }
    }
}

} // namespace test
