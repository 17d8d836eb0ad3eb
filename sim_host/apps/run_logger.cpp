// run_logger: writes every message of a run into one LCM event log, ordered by run time, and counts
// what was lost. Wakes up every few milliseconds and takes what has gathered, so that the loop that
// it listens to is not slowed by it (the stock lcm-logger keeps only part of such a stream).

#include <algorithm>
#include <ctime>
#include <malloc.h>
#include <map>

#include "apps/common_options.h"
#include "host/progress.h"
#include "link/lcm_batch_receiver.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

using namespace hpmc;

namespace {

constexpr long kBatch_ns = 20000000;
constexpr int kKeptBytes = 16 << 20;
constexpr int kReceiveBufferBytes = 32 << 20;
/// Messages wait so long, in run time, for earlier ones of other senders.
constexpr std::int64_t kHoldBack_us = 100000;

struct Options {
    std::string log;
    std::string plant_url = kDefaultPlantUrl;
    std::string telemetry_url = kDefaultTelemetryUrl;
    LogLevel level = LogLevel::full;
};

struct Message {
    std::int64_t utime;
    std::string channel;
    std::vector<std::uint8_t> payload;
};

class Logger {
  public:
    explicit Logger(const Options &options)
        : plant_(options.plant_url, options.level == LogLevel::states ? "ARM_STATE" : nullptr,
                 kReceiveBufferBytes),
          telemetry_(options.telemetry_url, nullptr, kReceiveBufferBytes), log_(options.log) {}

    void run() {
        while (!stop_signal_raised()) {
            const timespec pause{0, kBatch_ns};
            nanosleep(&pause, nullptr);
            collect();
            write_before(newest_utime_ - kHoldBack_us);
        }
        collect();
        write_before(INT64_MAX);
        log_.flush();
        std::printf("STATS {\"messages\": %lld, \"lost\": %lld}\n",
                    static_cast<long long>(log_.written()), static_cast<long long>(lost_));
    }

  private:
    void collect() {
        const auto take = [this](const lcm_udp_message_t &message) { this->take(message); };
        plant_.drain(take);
        telemetry_.drain(take);
    }

    /// Every type begins with fingerprint, utime, seq.
    void take(const lcm_udp_message_t &message) {
        if (message.payload_length < 24) {
            return;
        }
        const std::int64_t utime = big_endian_i64(message.payload + 8);
        const std::int64_t seq = big_endian_i64(message.payload + 16);
        if (seq < 0) {
            return; // asks for something (ARM_TARGET); what comes of it is published with its time
        }
        const auto [entry, first] = next_seq_.try_emplace(message.channel, seq);
        lost_ += first ? 0 : std::max<std::int64_t>(0, seq - entry->second);
        entry->second = seq + 1;
        newest_utime_ = std::max(newest_utime_, utime);
        waiting_.push_back(
            {utime, message.channel, {message.payload, message.payload + message.payload_length}});
    }

    void write_before(std::int64_t utime) {
        std::stable_sort(waiting_.begin(), waiting_.end(),
                         [](const Message &a, const Message &b) { return a.utime < b.utime; });
        std::size_t done = 0;
        while (done < waiting_.size() && waiting_[done].utime < utime) {
            const Message &m = waiting_[done++];
            log_.write(m.channel.c_str(), m.utime, m.payload.data(),
                       static_cast<int>(m.payload.size()));
        }
        waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(done));
    }

    LcmBatchReceiver plant_;
    LcmBatchReceiver telemetry_;
    LcmLogWriter log_;
    std::vector<Message> waiting_;
    std::map<std::string, std::int64_t> next_seq_;
    std::int64_t newest_utime_ = 0;
    std::int64_t lost_ = 0;
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"Writes the messages of a run into an LCM event log."};
    Options options;
    app.add_option("--log", options.log)->required();
    app.add_option("--plant-url", options.plant_url);
    app.add_option("--telemetry-url", options.telemetry_url);
    add_log_level(app, options.level);
    return run_app("run_logger", app, argc, argv, [&] {
        stop_signal_install(true);
        // Memory that is given back and taken again costs a page fault, dear in user-mode Linux.
        mallopt(M_TRIM_THRESHOLD, kKeptBytes);
        mallopt(M_TOP_PAD, kKeptBytes);
        Logger logger(options);
        say_ready();
        logger.run();
        return 0;
    });
}
