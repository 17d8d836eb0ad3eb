// telemetry_relay: hands a thinned-out stream of the telemetry to a viewer, through standard
// output, and the viewer's targets, from standard input, to the run. It may stand inside the run's
// sandbox, where it shares one processor with the lockstep loop: a filter in the kernel lets one
// HPMC_STATE in `--every` through and no CAN_FRAMES, what has gathered is taken in batches, and of
// each batch only what a picture needs goes on.
//
// Output: an LCM event log without end, time stamps in run time; channel RELAY holds a line of JSON
// with what was lost. Input: lines "x y", in m. Ends when either stream is closed.

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <linux/filter.h>
#include <map>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "apps/common_options.h"
#include "host/progress.h"
#include "hpmc_lcm/arm_target_t.hpp"
#include "link/lcm_batch_receiver.h"
#include "link/target_inbox.h"

using namespace hpmc;

namespace {

constexpr std::size_t kStatesPerBatch = 8;
constexpr int kReceiveBufferBytes = 8 << 20;
constexpr std::int64_t kStatsPeriod_ms = 1000;
constexpr std::uint32_t kSyncWord = 0xEDA1DA01U; ///< of an event in a log
constexpr std::size_t kHeaderBytes = 24;         ///< fingerprint, utime, seq of every type
constexpr std::size_t kInputMax = 4096;

struct Options {
    std::string url = kDefaultTelemetryUrl;
    unsigned every = 8;
    int batch_ms = 50; ///< each batch costs the sandbox some 0.8 ms on its way out
};

std::int64_t now_ms() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000LL + now.tv_nsec / 1000000;
}

constexpr std::uint32_t word(const char (&text)[5]) {
    return static_cast<std::uint32_t>(text[0]) << 24U | static_cast<std::uint32_t>(text[1]) << 16U |
           static_cast<std::uint32_t>(text[2]) << 8U | static_cast<std::uint32_t>(text[3]);
}

/// Takes HPMC_STATE whose seq is a multiple of `every` (a power of 2), NODE_STATUS_n, RUN_INFO and
/// ARM_TARGET. The filter sees a datagram from its UDP header on; the channel's name stands behind
/// it and LCM's own 8 bytes, the message behind the name's NUL.
void attach_filter(int fd, unsigned every) {
    constexpr std::uint32_t kName = 16;
    constexpr std::uint32_t kStateSeqLowByte = kName + sizeof "HPMC_STATE" + 16 + 7;
    const std::array<sock_filter, 11> program{{
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kName),               // 0
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("HPMC"), 5, 0), // 1: to 7
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("NODE"), 6, 0), // 2: to 9
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("RUN_"), 5, 0), // 3: to 9
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("ARM_"), 0, 5), // 4: else to 10
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kName + 4),           // 5
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("TARG"), 2, 3), // 6: to 9, else to 10
        BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kStateSeqLowByte),    // 7
        BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, every - 1U, 1, 0),  // 8: to 10, else to 9
        BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFFU),                  // 9
        BPF_STMT(BPF_RET | BPF_K, 0),                            // 10
    }};
    // The kernel's interface has no const.
    const sock_fprog filter{static_cast<unsigned short>(program.size()),
                            const_cast<sock_filter *>(program.data())};
    if (setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) != 0) {
        throw LinkError(std::string("socket filter: ") + std::strerror(errno));
    }
}

struct Message {
    std::string channel;
    std::int64_t utime = 0;
    std::vector<std::uint8_t> payload;
};

class Relay {
  public:
    explicit Relay(const Options &options)
        : batch_ms_(options.batch_ms), every_(options.every),
          receiver_(options.url, nullptr, kReceiveBufferBytes), targets_(options.url) {
        attach_filter(receiver_.fd(), options.every);
    }

    void run() {
        while (wait() && write_batch()) {
        }
    }

  private:
    /// Until the next batch is due; passes on targets at once. False when the viewer is gone.
    bool wait() {
        next_ms_ = std::max(next_ms_ + batch_ms_, now_ms());
        for (std::int64_t rest = batch_ms_; rest > 0; rest = next_ms_ - now_ms()) {
            pollfd input{STDIN_FILENO, POLLIN, 0};
            if (poll(&input, 1, static_cast<int>(rest)) > 0 && !read_targets()) {
                return false;
            }
        }
        return true;
    }

    bool read_targets() {
        std::array<char, kInputMax> bytes{};
        const ssize_t n = read(STDIN_FILENO, bytes.data(), bytes.size());
        if (n <= 0) {
            return n < 0 && errno == EINTR;
        }
        input_.append(bytes.data(), static_cast<std::size_t>(n));
        const std::size_t end = input_.rfind('\n');
        if (end == std::string::npos) {
            return input_.size() < kInputMax;
        }
        // Of several lines only the last is still wanted.
        const std::size_t begin = end == 0 ? std::string::npos : input_.rfind('\n', end - 1);
        const std::string line = input_.substr(begin + 1, end - begin - 1);
        input_.erase(0, end + 1);
        hpmc_lcm::arm_target_t target{};
        target.seq = -1;
        target.target = kOutsideTarget;
        if (std::sscanf(line.c_str(), "%lf %lf", &target.x_t_m[0], &target.x_t_m[1]) == 2 &&
            std::isfinite(target.x_t_m[0]) && std::isfinite(target.x_t_m[1])) {
            targets_.publish("ARM_TARGET", target);
            targets_.flush();
        }
        return true;
    }

    void take(const lcm_udp_message_t &message) {
        const std::string channel = message.channel;
        const std::int64_t seq = message.payload_length < static_cast<int>(kHeaderBytes)
                                     ? -1
                                     : big_endian_i64(message.payload + 16);
        const bool state = channel == "HPMC_STATE";
        // Also what slipped in before the filter stood.
        if (seq < 0 || channel == "CAN_FRAMES" || channel == "ARM_STATE" ||
            (state && seq % every_ != 0)) {
            return;
        }
        Message kept{channel,
                     big_endian_i64(message.payload + 8),
                     {message.payload, message.payload + message.payload_length}};
        if (!state) {
            newest_[channel] = std::move(kept);
            if (channel.rfind("NODE_STATUS", 0) != 0) {
                return;
            }
        }
        const auto [next, first] = next_seq_.try_emplace(channel, seq);
        // A smaller number is a new run on the same address.
        lost_ += first ? 0 : std::max<std::int64_t>(0, (seq - next->second) / (state ? every_ : 1));
        next->second = seq + (state ? every_ : 1);
        if (state) {
            states_.push_back(std::move(kept));
        }
    }

    bool write_batch() {
        receiver_.drain([this](const lcm_udp_message_t &message) { take(message); });
        out_.clear();
        for (const auto &[channel, message] : newest_) {
            put(channel, message.utime, message.payload);
        }
        newest_.clear();
        // Evenly spread, the newest among them.
        const std::size_t count = std::min(states_.size(), kStatesPerBatch);
        for (std::size_t i = 1; i <= count; ++i) {
            const Message &state = states_[states_.size() * i / count - 1];
            put(state.channel, state.utime, state.payload);
        }
        states_.clear();
        if (const std::int64_t now = now_ms(); now >= stats_ms_) {
            stats_ms_ = now + kStatsPeriod_ms;
            const std::string text = "{\"lost\": " + std::to_string(lost_) + "}";
            put("RELAY", 0, {text.begin(), text.end()});
        }
        return write_all();
    }

    template <class Unsigned> void put_number(Unsigned value) {
        for (int shift = 8 * (static_cast<int>(sizeof value) - 1); shift >= 0; shift -= 8) {
            out_.push_back(static_cast<std::uint8_t>(value >> static_cast<unsigned>(shift)));
        }
    }

    void put(const std::string &channel, std::int64_t utime,
             const std::vector<std::uint8_t> &payload) {
        put_number(kSyncWord);
        put_number(number_++);
        put_number(static_cast<std::uint64_t>(utime));
        put_number(static_cast<std::uint32_t>(channel.size()));
        put_number(static_cast<std::uint32_t>(payload.size()));
        out_.insert(out_.end(), channel.begin(), channel.end());
        out_.insert(out_.end(), payload.begin(), payload.end());
    }

    bool write_all() const {
        std::size_t done = 0;
        while (done < out_.size()) {
            const ssize_t n = write(STDOUT_FILENO, out_.data() + done, out_.size() - done);
            if (n < 0 && errno != EINTR) {
                return false;
            }
            done += n > 0 ? static_cast<std::size_t>(n) : 0;
        }
        return true;
    }

    int batch_ms_;
    std::int64_t every_;
    LcmBatchReceiver receiver_;
    LcmSender targets_;
    std::string input_;
    std::map<std::string, Message> newest_; ///< by channel, of all but HPMC_STATE
    std::vector<Message> states_;
    std::map<std::string, std::int64_t> next_seq_;
    std::vector<std::uint8_t> out_;
    std::uint64_t number_ = 0;
    std::int64_t lost_ = 0;
    std::int64_t next_ms_ = 0;
    std::int64_t stats_ms_ = 0;
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"Hands thinned-out telemetry to a viewer, and its targets to the run."};
    Options options;
    app.add_option("--lcm-url", options.url);
    app.add_option("--every", options.every, "one HPMC_STATE in so many")
        ->check(CLI::IsMember({1, 2, 4, 8, 16, 32, 64, 128}));
    app.add_option("--batch-ms", options.batch_ms, "ms between two batches")
        ->check(CLI::Range(5, 1000));
    return run_app("telemetry_relay", app, argc, argv, [&] {
        Relay relay(options);
        relay.run();
        return 0;
    });
}
