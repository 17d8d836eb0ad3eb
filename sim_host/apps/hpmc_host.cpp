// hpmc_host: the upper layers and the CANopen master as a process. Sees the arm through the nodes
// and the wrench sensor only; HAND_WRENCH opens each SYNC period, BUS_CLOSED ends its commands.

#include "apps/bench_host.h"
#include "apps/common_options.h"
#include "host/bus_account.h"
#include "host/progress.h"
#include "hpmc_lcm/bus_closed_t.hpp"
#include "hpmc_lcm/hand_wrench_t.hpp"
#include "link/can_bus.h"
#include "link/lcm_link.h"
#include "link/target_inbox.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

using namespace hpmc;

namespace {

struct Options {
    ConfigOptions config;
    std::string can = "vcan0";
    std::string plant_url = kDefaultPlantUrl;
    std::string telemetry_url = kDefaultTelemetryUrl;
    std::string targets;
    LogLevel level = LogLevel::full;
    int stall_timeout_ms = 10000;
    bool bench = false;
};

class HostProcess {
  public:
    HostProcess(const Options &options, const RunConfig &config)
        : config_(config), schedule_(config), cycle_(config), bus_(options.can),
          wrench_(options.plant_url, "HAND_WRENCH", options.stall_timeout_ms),
          plant_(options.plant_url), observers_(options.telemetry_url),
          telemetry_(config, "vcan", options.level) {
        if (!options.targets.empty()) {
            targets_.load(options.targets);
        }
        targets_.listen(options.telemetry_url);
    }

    int run() {
        const std::int64_t periods =
            config_.experiment.repetitions * schedule_.periods_per_repetition();
        for (std::int64_t period = 0; period < periods && !output_.finished; ++period) {
            if (stop_signal_raised()) {
                cycle_.request_stop();
            }
            try {
                step(period);
            } catch (const LinkError &) {
                // The wrench sensor or the bus fell silent: stop the nodes before giving up.
                bus_.send(quick_stop_frames().data(), kNodes);
                throw;
            }
            say_progress(period, cycle_.schedule_point());
        }
        observers_.flush();
        say_stats();
        if (!cycle_.fault().empty()) {
            std::fprintf(stderr, "hpmc_host: %s\n", cycle_.fault().c_str());
        }
        return cycle_.fault().empty() && !stop_signal_raised() ? 0 : kExitRunEnded;
    }

  private:
    void read_nodes(std::int64_t period) {
        // A run is not stopped between its periods but by its own quick stop.
        wrench_.await(period, wrench_message_, false);
        std::size_t expected = config_.sensors == Sensors::injected ? kNodes : 0;
        for (const std::int32_t sent : wrench_message_.frames_sent) {
            expected += static_cast<std::size_t>(sent);
        }
        PeriodFrames received{};
        bus_.receive(expected, received);
        from_nodes_.count = 0;
        injected_.count = 0;
        for (std::size_t i = 0; i < received.count; ++i) {
            const bool sensor = sender_of(received.frames[i]) > static_cast<int>(kNodes);
            (sensor ? injected_ : from_nodes_).append(&received.frames[i], 1);
        }
        from_nodes_.sort_by_identifier();
    }

    void close_bus(std::int64_t period) {
        hpmc_lcm::bus_closed_t message{};
        message.utime = period * kSyncPeriod_us;
        message.seq = period;
        PeriodFrames from_host;
        from_host.append(output_.frames.data(), output_.frame_count);
        for (std::size_t node = 1; node <= kNodes; ++node) {
            PeriodFrames inbox;
            deliver(static_cast<int>(node), from_nodes_, inbox);
            deliver(static_cast<int>(node), from_host, inbox);
            message.node_frames[node - 1] = static_cast<std::int32_t>(inbox.count);
        }
        plant_.publish("BUS_CLOSED", message);
        plant_.flush();
    }

    void step(std::int64_t period) {
        read_nodes(period);
        const Eigen::Vector2d wrench_N(wrench_message_.wrench_N[0], wrench_message_.wrench_N[1]);
        cycle_.step(
            {period, wrench_N, from_nodes_.frames.data(), from_nodes_.count, targets_.take(period)},
            output_);
        bus_.send(output_.frames.data(), output_.frame_count);
        injected_.sort_by_identifier();
        from_nodes_.append(injected_.frames.data(), injected_.count);
        close_bus(period);
        account_.add(period, from_nodes_, output_);
        telemetry_.publish(observers_, cycle_, from_nodes_, output_);
    }

    void say_stats() const {
        const can_socket_t &socket = bus_.socket();
        std::printf("STATS {\"frames\": %lld, \"frames_lost\": %u, \"load_typical_percent\": %.2f, "
                    "\"back_pressure\": %u, \"error_frames\": %u, \"outside_targets\": %lld, "
                    "\"outside_targets_refused\": %lld, \"outside_targets_dropped\": %lld}\n",
                    static_cast<long long>(account_.frames()), socket.dropped,
                    account_.load_typical_percent(), socket.back_pressure, socket.error_frames,
                    static_cast<long long>(cycle_.outside_targets()),
                    static_cast<long long>(cycle_.outside_targets_refused()),
                    static_cast<long long>(targets_.dropped()));
        std::fflush(stdout);
    }

    RunConfig config_;
    RunSchedule schedule_;
    HostCycle cycle_;
    CanBus bus_;
    LcmReceiver wrench_;
    LcmSender plant_;
    LcmSender observers_;
    TargetInbox targets_;
    Telemetry telemetry_;
    BusAccount account_;
    hpmc_lcm::hand_wrench_t wrench_message_{};
    PeriodFrames from_nodes_{};
    PeriodFrames injected_{};
    HostCycleOutput output_;
};

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"Host layers of H-PMC and CANopen master."};
    Options options;
    options.config.add_to(app);
    app.add_option("--can", options.can, "CAN interface");
    app.add_option("--plant-url", options.plant_url);
    app.add_option("--telemetry-url", options.telemetry_url);
    app.add_option("--targets", options.targets,
                   "LCM event log: its targets from outside act again, at their time");
    add_log_level(app, options.level);
    app.add_flag("--bench", options.bench, "SYNC by the wall clock, nothing waits for frames");
    app.add_option("--stall-timeout-ms", options.stall_timeout_ms)->check(CLI::Range(100, 600000));
    return run_app("hpmc_host", app, argc, argv, [&] {
        const RunConfig config = options.config.load();
        stop_signal_install(false);
        if (options.bench) {
            BenchHost host({options.can, options.plant_url, options.telemetry_url, options.level,
                            options.stall_timeout_ms},
                           config);
            say_ready();
            return host.run();
        }
        HostProcess host(options, config);
        say_ready();
        return host.run();
    });
}
