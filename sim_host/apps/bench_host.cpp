#include "apps/bench_host.h"

#include "apps/common_options.h"
#include "host/progress.h"
#include "hpmc_lcm/bus_closed_t.hpp"
#include "link/motor_node_od.h"

extern "C" {
#include "port/posix/stop_signal.h"
}

namespace hpmc {
namespace {

constexpr std::int64_t kJointTicksMax = 10; ///< 2100h:08
constexpr std::int64_t kRelease_ns = 50000000;

RunConfig checked(const RunConfig &config) {
    if (config.bus.pipeline != 2) {
        throw ConfigError("bus.pipeline: must be 2 on a bench");
    }
    if (config.bus.command_delay_ms != 0) {
        throw ConfigError("bus.command_delay_ms: must be 0 on a bench");
    }
    if (config.sensors == Sensors::direct &&
        config.joint.rate_Hz / config.bench.sync_Hz > kJointTicksMax) {
        throw ConfigError("bench.sync_Hz: must be at least joint.rate_Hz / 10 with a real arm");
    }
    return config;
}

TimeBase time_base(const RunConfig &config) {
    return config.sensors == Sensors::injected ? TimeBase::stepped : TimeBase::free_running;
}

can_frame_t to_node(unsigned function, std::size_t node, std::initializer_list<unsigned> bytes) {
    can_frame_t frame{};
    frame.id = static_cast<std::uint16_t>(function + node);
    frame.len = 8;
    std::size_t i = 0;
    for (const unsigned byte : bytes) {
        frame.data[i++] = static_cast<std::uint8_t>(byte);
    }
    return frame;
}

} // namespace

BenchBus::BenchBus(const std::string &address) {
    if (address.rfind("slcan:", 0) == 0) {
        adapter_ = std::make_unique<SlcanLink>(address, "SLCAN adapter");
        adapter_->open_adapter();
    } else {
        can_ = std::make_unique<CanBus>(address);
    }
}

void BenchBus::send(const can_frame_t *frames, std::size_t count) {
    adapter_ ? adapter_->send(frames, count) : can_->send(frames, count);
}

void BenchBus::receive_available(PeriodFrames &frames) {
    adapter_ ? adapter_->receive_available(frames) : can_->receive_available(frames);
}

std::string BenchBus::losses_json(std::size_t beyond) const {
    char text[160];
    if (adapter_) {
        const SlcanStats &stats = adapter_->stats();
        std::snprintf(text, sizeof text, "\"frames_lost\": %lld, \"refused\": %lld",
                      static_cast<long long>(stats.garbled) + static_cast<long long>(beyond),
                      static_cast<long long>(stats.refused));
    } else {
        const can_socket_t &socket = can_->socket();
        std::snprintf(text, sizeof text,
                      "\"frames_lost\": %zu, \"back_pressure\": %u, \"error_frames\": %u",
                      socket.dropped + beyond, socket.back_pressure, socket.error_frames);
    }
    return text;
}

BenchHost::BenchHost(const BenchOptions &options, const RunConfig &config)
    : config_(checked(config)), injected_(config.sensors == Sensors::injected), schedule_(config),
      cycle_(config, time_base(config)), encoder_check_(config), bus_(options.can),
      plant_(options.plant_url), observers_(options.telemetry_url),
      telemetry_(config, "bench", options.level),
      pacer_(1000000000 / config.bench.sync_Hz, Pacer::WhenLate::start_anew) {
    if (injected_) {
        wrench_ = std::make_unique<LcmReceiver>(options.plant_url, "HAND_WRENCH",
                                                options.stall_timeout_ms);
    }
    realtime_ = become_realtime();
}

int BenchHost::run() {
    if (!injected_) {
        release_nodes();
        check_encoders();
        if (!encoder_check_.fault().empty() || stop_signal_raised()) {
            return end(encoder_check_.fault());
        }
    }
    run_experiment();
    return end(cycle_.fault());
}

int BenchHost::end(const std::string &fault) {
    observers_.flush();
    say_stats();
    if (!fault.empty()) {
        std::fprintf(stderr, "hpmc_host: %s\n", fault.c_str());
    }
    return fault.empty() && !stop_signal_raised() ? 0 : kExitRunEnded;
}

/// A node that a run with injected sensors has left in the stepped time base takes in nothing until
/// its RPDO4 closes a tick; elsewhere these frames change nothing.
void BenchHost::release_nodes() {
    can_frame_t reset{};
    reset.len = 2;
    reset.data[0] = 0x81;
    std::array<can_frame_t, 1 + 4 * kJoints> frames;
    std::size_t count = 0;
    frames[count++] = reset;
    for (const unsigned tick : {0U, 1U}) {
        for (std::size_t node = 1; node <= kJoints; ++node) {
            if (tick == 1U) {
                const unsigned time_base = motor_node_od::kTimeBase.index;
                frames[count++] = to_node(0x600, node, {0x2F, time_base & 0xFFU, time_base >> 8U});
            }
            frames[count++] = to_node(0x500, node, {0, 0, 0, 0, tick});
        }
    }
    bus_.send(frames.data(), count);
    const timespec wait{0, kRelease_ns};
    clock_nanosleep(CLOCK_MONOTONIC, 0, &wait, nullptr);
    read_bus(); // answers to these, and what was on the bus before
}

/// A quick stop before the run ends; what the bus then says does not hide the first cause.
template <class Cycle> void BenchHost::stop_when_the_bus_fails(Cycle cycle) {
    try {
        cycle();
    } catch (const LinkError &) {
        try {
            bus_.send(quick_stop_frames().data(), kNodes);
        } catch (const LinkError &) { // the nodes' own deadline stops them
        }
        throw;
    }
}

void BenchHost::check_encoders() {
    while (!output_.finished) {
        if (stop_signal_raised()) {
            encoder_check_.request_stop();
        }
        pacer_.wait();
        stop_when_the_bus_fails([&] {
            read_bus();
            encoder_check_.step(from_nodes_.frames.data(), from_nodes_.count, output_);
            send();
        });
    }
    output_ = {};
}

void BenchHost::run_experiment() {
    const std::int64_t periods =
        config_.experiment.repetitions * schedule_.periods_per_repetition();
    for (std::int64_t period = 0; period < periods && !output_.finished; ++period) {
        if (stop_signal_raised()) {
            cycle_.request_stop();
        }
        stop_when_the_bus_fails([&] { step(period); });
        say_progress(period, cycle_.schedule_point());
    }
}

void BenchHost::read_bus() {
    PeriodFrames received{};
    bus_.receive_available(received);
    from_nodes_.count = 0;
    sensors_.count = 0;
    for (std::size_t i = 0; i < received.count; ++i) {
        const int sender = sender_of(received.frames[i]);
        if (sender > static_cast<int>(kNodes)) {
            sensors_.append(&received.frames[i], 1);
        } else if (sender > 0) {
            from_nodes_.append(&received.frames[i], 1);
        }
    }
    frames_beyond_ += received.dropped;
    from_nodes_.sort_by_identifier();
    sensors_.sort_by_identifier();
}

void BenchHost::send() {
    bus_.send(output_.frames.data(), output_.frame_count);
}

/// Tells bench_bridge that the host's frames of this period are on the bus.
void BenchHost::close_bus(std::int64_t period) {
    hpmc_lcm::bus_closed_t message{};
    message.utime = period * kSyncPeriod_us;
    message.seq = period;
    PeriodFrames from_host;
    from_host.append(output_.frames.data(), output_.frame_count);
    for (std::size_t node = 1; node <= kNodes; ++node) {
        PeriodFrames inbox;
        deliver(static_cast<int>(node), from_host, inbox);
        message.node_frames[node - 1] = static_cast<std::int32_t>(inbox.count);
    }
    plant_.publish("BUS_CLOSED", message);
    plant_.flush();
}

void BenchHost::step(std::int64_t period) {
    Eigen::Vector2d wrench_N = Eigen::Vector2d::Zero();
    if (injected_) {
        wrench_->await(period, wrench_message_, false);
        wrench_N = {wrench_message_.wrench_N[0], wrench_message_.wrench_N[1]};
    }
    pacer_.wait();
    read_bus();
    cycle_.step({period, wrench_N, from_nodes_.frames.data(), from_nodes_.count}, output_);
    send();
    if (injected_) {
        close_bus(period);
    }
    from_nodes_.append(sensors_.frames.data(), sensors_.count);
    account_.add(period, from_nodes_, output_);
    telemetry_.publish(observers_, cycle_, from_nodes_, output_);
}

void BenchHost::say_stats() const {
    std::printf("STATS {\"frames\": %lld, \"load_typical_percent\": %.2f, %s, %s, %s%s%s}\n",
                static_cast<long long>(account_.frames()),
                account_.load_typical_percent() * static_cast<double>(config_.bench.sync_Hz) /
                    1000.0,
                bus_.losses_json(frames_beyond_).c_str(), pacer_.stats_json().c_str(),
                hpmc::to_json(realtime_).c_str(), injected_ ? "" : ", ",
                injected_ ? "" : encoder_check_.to_json().c_str());
    std::fflush(stdout);
}

} // namespace hpmc
