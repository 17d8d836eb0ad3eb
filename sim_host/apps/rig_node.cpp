#include "apps/rig_node.h"

#include <algorithm>
#include <cstdio>

#include "link/lcm_link.h"
#include "link/motor_node_od.h"

namespace hpmc {
namespace {

constexpr std::uint16_t kTpdo1 = 0x180;
constexpr std::uint16_t kRpdo4 = 0x500;
constexpr std::uint16_t kSdoAnswer = 0x580;
constexpr std::uint16_t kSdoRequest = 0x600;

std::string name_of(std::uint8_t node_id) {
    return "motor node " + std::to_string(node_id);
}

} // namespace

NativeNode::NativeNode(std::uint8_t node_id) {
    config_.node_id = node_id;
    config_.serial_number = node_id;
    config_.referenced = true;
    motor_node_init(&config_, &device_);
}

void NativeNode::begin(const RigNodeTick &tick) {
    motor_node_input_t input{};
    input.elapsed_us = tick.elapsed_us;
    input.position_inc = tick.position_inc;
    input.temperature_dC = tick.temperature_dC;
    input.frames = tick.frames;
    input.frame_count = tick.frame_count;
    motor_node_step(&config_, &device_, &input, &output_);
    if (output_.reset_requested) {
        motor_node_restart(&config_, &device_);
    }
}

void NativeNode::end(PeriodFrames &sent) {
    sent.append(output_.frames, output_.frame_count);
}

double NativeNode::torque_Nm() const {
    return output_.torque_mNm / 1000.0;
}

EmulatedNode::EmulatedNode(std::uint8_t node_id, const std::string &address)
    : node_id_(node_id), name_(name_of(node_id)), link_(address, name_) {
    set_up();
}

EmulatedNode::EmulatedNode(std::uint8_t node_id, int fd)
    : node_id_(node_id), name_(name_of(node_id)), link_(fd, name_) {
    set_up();
}

/// Sensors first: once the time base is stepped, the node answers at the end of a tick only.
void EmulatedNode::set_up() {
    link_.open_node();
    write_object(motor_node_od::kSensorSource.index, 1);
    write_object(motor_node_od::kTimeBase.index, 1);
}

void EmulatedNode::write_object(std::uint16_t index, std::uint8_t value) {
    constexpr std::uint8_t kDownloadOneByte = 0x2F; // CiA 301 7.2.4.3.3
    constexpr std::uint8_t kDownloaded = 0x60;
    const can_frame_t request{static_cast<std::uint16_t>(kSdoRequest + node_id_),
                              8,
                              {kDownloadOneByte, static_cast<std::uint8_t>(index & 0xFFU),
                               static_cast<std::uint8_t>(index >> 8U), 0, value, 0, 0, 0}};
    PeriodFrames received;
    link_.send(&request, 1);
    link_.await_answers(received);
    const can_frame_t *end = received.frames.data() + received.count;
    const can_frame_t *begin = received.frames.data();
    const can_frame_t *answer = std::find_if(begin, end, [&](const can_frame_t &frame) {
        return frame.id == kSdoAnswer + node_id_ && frame.len == 8;
    });
    char text[96];
    if (answer == end) {
        std::snprintf(text, sizeof text, ": no answer to an SDO request; is it node-id %u?",
                      static_cast<unsigned>(node_id_));
        throw LinkError(name_ + text);
    }
    if (answer->data[0] != kDownloaded) {
        const auto code = static_cast<unsigned>(answer->data[4]) |
                          static_cast<unsigned>(answer->data[5]) << 8U |
                          static_cast<unsigned>(answer->data[6]) << 16U |
                          static_cast<unsigned>(answer->data[7]) << 24U;
        std::snprintf(text, sizeof text, ": refused object %04Xh = %u with SDO abort %08Xh", index,
                      static_cast<unsigned>(value), code);
        throw LinkError(name_ + text);
    }
}

void EmulatedNode::begin(const RigNodeTick &tick) {
    PeriodFrames ordered;
    PeriodFrames closing; // RPDO4, to be sent last
    for (std::size_t i = 0; i < tick.frame_count; ++i) {
        const bool closes = tick.frames[i].id == kRpdo4 + node_id_;
        (closes ? closing : ordered).append(&tick.frames[i], 1);
    }
    ordered.append(closing.frames.data(), closing.count);
    link_.send(ordered.frames.data(), ordered.count);
}

void EmulatedNode::end(PeriodFrames &sent) {
    const std::size_t first = sent.count;
    link_.await_answers(sent);
    for (std::size_t i = first; i < sent.count; ++i) {
        const can_frame_t &frame = sent.frames[i];
        if (frame.id == kTpdo1 + node_id_ && frame.len == 8) {
            torque_Nm_ = static_cast<std::int16_t>(frame.data[4] | frame.data[5] << 8U) / 1000.0;
        }
    }
}

} // namespace hpmc
