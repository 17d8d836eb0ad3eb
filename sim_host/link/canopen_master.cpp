#include "link/canopen_master.h"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace hpmc {
namespace {

// COB-IDs, CiA 301 table 38 and 39.
constexpr std::uint16_t kNmt = 0x000;
constexpr std::uint16_t kSync = 0x080;
constexpr std::uint16_t kEmcy = 0x080;
constexpr std::uint16_t kTpdo1 = 0x180;
constexpr std::uint16_t kRpdo1 = 0x200;
constexpr std::uint16_t kTpdo2 = 0x280;
constexpr std::uint16_t kRpdo2 = 0x300;
constexpr std::uint16_t kSdoAnswer = 0x580;
constexpr std::uint16_t kSdoRequest = 0x600;
constexpr std::uint16_t kHeartbeat = 0x700;
constexpr std::uint16_t kHostId = 127;

constexpr std::uint8_t kNmtStart = 0x01;
constexpr std::uint8_t kNmtStop = 0x02;
constexpr std::uint8_t kNmtResetNode = 0x81;
constexpr std::uint8_t kNmtOperational = 0x05;
constexpr std::uint8_t kSyncCounterMax = 240;

// CiA 402-2: statusword under its mask, and the controlword that leads on from there.
constexpr std::uint16_t kStateMask = 0x006F;
constexpr std::uint16_t kReadyToSwitchOn = 0x0021;
constexpr std::uint16_t kSwitchedOn = 0x0023;
constexpr std::uint16_t kOperationEnabled = 0x0027;
constexpr std::uint16_t kSwitchOnDisabledMask = 0x004F;
constexpr std::uint16_t kSwitchOnDisabled = 0x0040;
constexpr std::uint16_t kShutdown = 0x0006;
constexpr std::uint16_t kSwitchOn = 0x0007;
constexpr std::uint16_t kEnableOperation = 0x000F;
constexpr std::uint16_t kQuickStop = 0x0002;
constexpr std::uint16_t kDisableVoltage = 0x0000;

// Bounds of every wait, in SYNC periods.
constexpr std::uint32_t kBootPeriods = 100;
constexpr std::uint32_t kSdoPeriods = 50;
constexpr std::uint32_t kRepeatControlwordPeriods = 10;
constexpr std::uint32_t kEnablePeriods = 300;
constexpr std::uint32_t kSilentPeriods = 2;
constexpr std::uint32_t kOwedMax = 2; ///< an older reply is lost, not late

can_frame_t make_frame(std::uint16_t id, std::initializer_list<unsigned> bytes) {
    can_frame_t frame{};
    frame.id = id;
    frame.len = static_cast<std::uint8_t>(bytes.size());
    std::size_t i = 0;
    for (const unsigned byte : bytes) {
        frame.data[i++] = static_cast<std::uint8_t>(byte & 0xFFU);
    }
    return frame;
}

std::uint32_t get_le(const can_frame_t &frame, std::size_t at, std::size_t bytes) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < bytes; ++i) {
        value |= static_cast<std::uint32_t>(frame.data[at + i]) << (8U * i);
    }
    return value;
}

std::uint16_t id_of(std::size_t joint) {
    return static_cast<std::uint16_t>(joint + 1);
}

std::uint16_t next_controlword(std::uint16_t statusword) {
    if ((statusword & kSwitchOnDisabledMask) == kSwitchOnDisabled) {
        return kShutdown;
    }
    switch (statusword & kStateMask) {
    case kReadyToSwitchOn:
        return kSwitchOn;
    case kSwitchedOn:
    case kOperationEnabled:
        return kEnableOperation;
    default:
        return kShutdown;
    }
}

bool is_enabled(const NodeView &node) {
    return (node.statusword & kStateMask) == kOperationEnabled;
}

can_frame_t rpdo2(std::size_t joint, std::uint16_t controlword, std::int8_t mode) {
    return make_frame(static_cast<std::uint16_t>(kRpdo2 + id_of(joint)),
                      {controlword & 0xFFU, static_cast<unsigned>(controlword) >> 8U,
                       static_cast<std::uint8_t>(mode)});
}

} // namespace

std::array<can_frame_t, kJoints> quick_stop_frames() {
    return {rpdo2(0, kQuickStop, 0), rpdo2(1, kQuickStop, 0), rpdo2(2, kQuickStop, 0)};
}

CanopenMaster::CanopenMaster(CanopenMasterConfig config) : config_(std::move(config)) {
    restart();
}

void CanopenMaster::restart() {
    enter(MasterStage::reset);
    periods_to_heartbeat_ = 0;
    sync_counter_ = 0;
    next_joint_ = 0;
    nodes_ = {};
    news_ = {};
    configured_ = {};
    periods_to_answer_ = {};
    controlword_ = {};
    periods_since_controlword_ = {};
    fault_.clear();
}

void CanopenMaster::enter(MasterStage stage) {
    stage_ = stage;
    periods_in_stage_ = 0;
}

void CanopenMaster::fail(std::size_t joint, const std::string &what) {
    if (fault_.empty()) {
        fault_ = "motor node " + std::to_string(joint + 1) + ": " + what;
    }
}

bool CanopenMaster::all_enabled() const {
    return std::all_of(nodes_.begin(), nodes_.end(), is_enabled);
}

void CanopenMaster::on_sdo(std::size_t joint, const can_frame_t &frame) {
    if (stage_ != MasterStage::configure || periods_to_answer_[joint] == 0 || frame.len != 8) {
        return;
    }
    const SdoWrite &write = config_.configuration[joint][configured_[joint]];
    const bool same_object = get_le(frame, 1, 2) == write.index && frame.data[3] == write.subindex;
    char text[96];
    if (frame.data[0] == 0x60 && same_object) {
        periods_to_answer_[joint] = 0;
        ++configured_[joint];
    } else if (frame.data[0] == 0x80) {
        std::snprintf(text, sizeof text, "refused object %04Xh:%02X = %u with SDO abort %08Xh",
                      write.index, write.subindex, write.value, get_le(frame, 4, 4));
        fail(joint, text);
    }
}

void CanopenMaster::on_node_frame(std::size_t joint, const can_frame_t &frame) {
    NodeView &node = nodes_[joint];
    switch (frame.id - id_of(joint)) {
    case kTpdo1:
        ++node.tpdo1_in_period;
        if (frame.len == 8) {
            node.position_inc = static_cast<std::int32_t>(get_le(frame, 0, 4));
            node.torque_mNm = static_cast<std::int16_t>(get_le(frame, 4, 2));
            node.statusword = static_cast<std::uint16_t>(get_le(frame, 6, 2));
        }
        break;
    case kTpdo2:
        if (frame.len == 7) {
            node.mode_display = static_cast<std::int8_t>(frame.data[0]);
            node.limit_reasons = static_cast<std::uint16_t>(get_le(frame, 1, 2));
            node.missed_sync = static_cast<std::uint16_t>(get_le(frame, 3, 2));
            node.temperature_dC = static_cast<std::int16_t>(get_le(frame, 5, 2));
        }
        break;
    case kEmcy:
        if (frame.len == 8) {
            node.emcy_code = static_cast<std::uint16_t>(get_le(frame, 0, 2));
            node.error_register = frame.data[2];
            ++node.emcy_count;
            news_[joint] = true;
        }
        break;
    case kSdoAnswer:
        on_sdo(joint, frame);
        break;
    case kHeartbeat:
        if (frame.len == 1) {
            const auto state = static_cast<std::uint8_t>(frame.data[0] & 0x7FU);
            news_[joint] = news_[joint] || state != node.nmt_state;
            node.nmt_state = state;
            node.booted = node.booted || (state == 0 && stage_ == MasterStage::boot);
        }
        break;
    default:
        break;
    }
}

/// The host's own reaction table (docs/protocol.md) as far as it concerns the nodes.
void CanopenMaster::watch() {
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        NodeView &node = nodes_[joint];
        const bool cyclic = stage_ == MasterStage::enable || stage_ == MasterStage::enabled;
        const std::uint32_t allowed = config_.wall_clock ? std::max(node.owed_tpdo1, 1U) : 1U;
        node.owed_tpdo1 -= std::min(node.owed_tpdo1, node.tpdo1_in_period);
        node.periods_without_tpdo1 = node.tpdo1_in_period == 0 ? node.periods_without_tpdo1 + 1 : 0;
        if (cyclic && periods_in_stage_ > 0) {
            if (node.tpdo1_in_period > allowed) {
                fail(joint,
                     "sent " + std::to_string(node.tpdo1_in_period) + " TPDO1 in one period");
            } else if (node.periods_without_tpdo1 >= kSilentPeriods &&
                       (stage_ == MasterStage::enabled || periods_in_stage_ > kSilentPeriods)) {
                fail(joint, "sent no TPDO1 for " + std::to_string(node.periods_without_tpdo1) +
                                " periods");
            }
        }
        if (news_[joint] && node.emcy_code != 0 && stage_ != MasterStage::stopping &&
            stage_ != MasterStage::stopped) {
            char text[80];
            std::snprintf(text, sizeof text, "emergency %04Xh, error register %02Xh",
                          node.emcy_code, node.error_register);
            fail(joint, text);
        }
        if (stage_ == MasterStage::enabled && node.periods_without_tpdo1 == 0 &&
            !is_enabled(node)) {
            char text[80];
            std::snprintf(text, sizeof text, "left operation enabled, statusword %04Xh",
                          node.statusword);
            fail(joint, text);
        }
        if (periods_to_answer_[joint] > 0 && --periods_to_answer_[joint] == 0) {
            fail(joint, "did not answer an SDO request within " + std::to_string(kSdoPeriods) +
                            " periods");
        }
        if (stage_ == MasterStage::boot && periods_in_stage_ > kBootPeriods && !node.booted) {
            fail(joint, "did not boot");
        }
        if (stage_ == MasterStage::enable && periods_in_stage_ > kEnablePeriods &&
            !is_enabled(node)) {
            char text[96];
            std::snprintf(
                text, sizeof text,
                "was not enabled within %u periods, statusword %04Xh, limit reasons %04Xh",
                kEnablePeriods, node.statusword, node.limit_reasons);
            fail(joint, text);
        }
    }
}

const std::string &CanopenMaster::receive(const can_frame_t *frames, std::size_t count) {
    news_ = {};
    for (NodeView &node : nodes_) {
        node.tpdo1_in_period = 0;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t node_id = frames[i].id & 0x7FU;
        if (node_id >= 1 && node_id <= kJoints) {
            on_node_frame(node_id - 1, frames[i]);
        }
    }
    watch();
    // Not before the second period: a node just powered on reports itself before the reset takes.
    if (stage_ == MasterStage::boot && periods_in_stage_ > 0 &&
        std::all_of(nodes_.begin(), nodes_.end(), [](const NodeView &n) { return n.booted; })) {
        enter(MasterStage::configure);
    }
    if (stage_ == MasterStage::enable && all_enabled()) {
        enter(MasterStage::enabled);
    }
    return fault_;
}

bool CanopenMaster::compose_configuration(Frames &frames, std::size_t &count) {
    for (std::size_t turn = 0; turn < kJoints; ++turn) {
        const std::size_t joint = (next_joint_ + turn) % kJoints;
        const auto &writes = config_.configuration[joint];
        if (periods_to_answer_[joint] > 0 || configured_[joint] == writes.size()) {
            continue;
        }
        const SdoWrite &w = writes[configured_[joint]];
        // CiA 301 7.2.4.3.3: expedited download, size indicated.
        const unsigned command = 0x23U | static_cast<unsigned>(4 - w.bytes) << 2U;
        frames[count++] = make_frame(
            static_cast<std::uint16_t>(kSdoRequest + id_of(joint)),
            {command, w.index & 0xFFU, static_cast<unsigned>(w.index) >> 8U, w.subindex,
             w.value & 0xFFU, w.value >> 8U & 0xFFU, w.value >> 16U & 0xFFU, w.value >> 24U});
        periods_to_answer_[joint] = kSdoPeriods;
        next_joint_ = (joint + 1) % kJoints;
        return true;
    }
    return false;
}

bool CanopenMaster::compose_enabling(Frames &frames, std::size_t &count) {
    for (std::uint32_t &periods : periods_since_controlword_) {
        ++periods;
    }
    for (std::size_t turn = 0; turn < kJoints; ++turn) {
        const std::size_t joint = (next_joint_ + turn) % kJoints;
        const NodeView &node = nodes_[joint];
        const std::uint16_t wanted = next_controlword(node.statusword);
        const bool repeat = wanted == controlword_[joint] &&
                            periods_since_controlword_[joint] < kRepeatControlwordPeriods;
        if (node.periods_without_tpdo1 > 0 || is_enabled(node) || repeat) {
            continue;
        }
        frames[count++] = rpdo2(joint, wanted, config_.mode);
        controlword_[joint] = wanted;
        periods_since_controlword_[joint] = 0;
        next_joint_ = (joint + 1) % kJoints;
        return true;
    }
    return false;
}

void CanopenMaster::compose_stopping(Frames &frames, std::size_t &count) {
    const bool at_rest = std::none_of(nodes_.begin(), nodes_.end(), [](const NodeView &n) {
        const std::uint16_t state = n.statusword & kStateMask;
        return state == kOperationEnabled || state == 0x0007; // or quick stop active
    });
    if (periods_in_stage_ == 0) {
        for (const can_frame_t &frame : quick_stop_frames()) {
            frames[count++] = frame;
        }
    } else if (at_rest || periods_in_stage_ > config_.stop_periods) {
        frames[count++] = rpdo2(next_joint_, kDisableVoltage, 0);
        if (++next_joint_ == kJoints) {
            enter(MasterStage::stopped);
        }
    }
}

void CanopenMaster::compose_cyclic(const std::array<JointCommand, kJoints> &commands,
                                   Frames &frames, std::size_t &count) {
    for (std::size_t joint = 0; joint < kJoints; ++joint) {
        const JointCommand &c = commands[joint];
        const auto position = static_cast<std::uint32_t>(c.position_inc);
        const auto torque = static_cast<std::uint16_t>(c.torque_mNm);
        frames[count++] =
            make_frame(static_cast<std::uint16_t>(kRpdo1 + id_of(joint)),
                       {position & 0xFFU, position >> 8U & 0xFFU, position >> 16U & 0xFFU,
                        position >> 24U, torque & 0xFFU, static_cast<unsigned>(torque) >> 8U,
                        c.torque_max_mNm & 0xFFU, static_cast<unsigned>(c.torque_max_mNm) >> 8U});
    }
}

void CanopenMaster::compose_sync(Frames &frames, std::size_t &count) {
    sync_counter_ = sync_counter_ == kSyncCounterMax ? std::uint8_t{1}
                                                     : static_cast<std::uint8_t>(sync_counter_ + 1);
    frames[count++] = make_frame(kSync, {sync_counter_});
    for (NodeView &node : nodes_) {
        node.owed_tpdo1 = std::min(node.owed_tpdo1 + 1, kOwedMax);
    }
}

std::size_t CanopenMaster::compose(const std::array<JointCommand, kJoints> &commands,
                                   std::array<can_frame_t, kFramesMax> &frames) {
    std::size_t count = 0;
    bool cyclic = false;
    bool acyclic_sent = false;
    const MasterStage now = stage_;
    const bool sync =
        now == MasterStage::enable || now == MasterStage::enabled || now == MasterStage::stopping;
    if (sync && config_.sync_first) {
        compose_sync(frames, count);
    }
    const std::size_t heads = count;
    switch (now) {
    case MasterStage::reset:
        frames[count++] = make_frame(kNmt, {kNmtResetNode, 0});
        enter(MasterStage::boot);
        return count;
    case MasterStage::boot:
        break;
    case MasterStage::configure: {
        acyclic_sent = compose_configuration(frames, count);
        bool done = true;
        for (std::size_t joint = 0; joint < kJoints; ++joint) {
            done = done && configured_[joint] == config_.configuration[joint].size();
        }
        if (done) {
            enter(MasterStage::start);
        }
        break;
    }
    case MasterStage::start:
        frames[count++] = make_frame(kNmt, {kNmtStart, 0});
        next_joint_ = 0;
        enter(MasterStage::enable);
        return count;
    case MasterStage::enable:
        acyclic_sent = compose_enabling(frames, count);
        cyclic = true;
        break;
    case MasterStage::enabled:
        cyclic = true;
        break;
    case MasterStage::stopping:
        compose_stopping(frames, count);
        acyclic_sent = count > heads;
        cyclic = count - heads < kJoints;
        break;
    case MasterStage::stopped:
        if (periods_in_stage_ == 0) {
            frames[count++] = make_frame(kNmt, {kNmtStop, 0});
            acyclic_sent = true;
        }
        break;
    }
    if (periods_to_heartbeat_ == 0 && !acyclic_sent) {
        frames[count++] = make_frame(kHeartbeat + kHostId, {kNmtOperational});
        periods_to_heartbeat_ = config_.heartbeat_periods;
    }
    if (periods_to_heartbeat_ > 0) {
        --periods_to_heartbeat_;
    }
    if (cyclic) {
        compose_cyclic(commands, frames, count);
    }
    if (sync && !config_.sync_first) {
        compose_sync(frames, count);
    }
    if (stage_ == now) {
        ++periods_in_stage_;
    }
    return count;
}

void CanopenMaster::stop() {
    if (stage_ == MasterStage::enable || stage_ == MasterStage::enabled) {
        next_joint_ = 0;
        enter(MasterStage::stopping);
    } else if (stage_ != MasterStage::stopping && stage_ != MasterStage::stopped) {
        enter(MasterStage::stopped);
    }
}

} // namespace hpmc
