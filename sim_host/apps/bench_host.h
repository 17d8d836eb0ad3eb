/**
 * hpmc_host on a real bus: the same cycle as in lockstep, begun by the wall clock. Nothing waits
 * for frames: what has arrived by the cycle's time counts.
 *
 * With injected sensors (a simulated arm, stepped nodes) a cycle that is not through is waited for
 * and counted, since node time stands still meanwhile. Without (a real arm, free-running nodes) the
 * encoders are checked before the first motion.
 */
#pragma once

#include <memory>
#include <string>

#include "host/bus_account.h"
#include "host/encoder_check.h"
#include "host/telemetry.h"
#include "hpmc_lcm/hand_wrench_t.hpp"
#include "link/can_bus.h"
#include "link/lcm_link.h"
#include "link/pacer.h"
#include "link/realtime.h"
#include "link/slcan_link.h"

namespace hpmc {

/// The bus by its address: an interface of the kernel, or slcan:DEVICE, an SLCAN adapter.
class BenchBus {
  public:
    explicit BenchBus(const std::string &address);

    void send(const can_frame_t *frames, std::size_t count);
    /// Appends the frames that are there, without waiting.
    void receive_available(PeriodFrames &frames);
    /// Losses as the inside of a JSON object; `beyond`: frames that the host had no room for.
    std::string losses_json(std::size_t beyond) const;

  private:
    std::unique_ptr<CanBus> can_;
    std::unique_ptr<SlcanLink> adapter_;
};

struct BenchOptions {
    std::string can;
    std::string plant_url;
    std::string telemetry_url;
    LogLevel level = LogLevel::full;
    int stall_timeout_ms = 10000;
};

class BenchHost {
  public:
    /// Throws ConfigError where the configuration does not suit a bench.
    BenchHost(const BenchOptions &options, const RunConfig &config);

    /// Runs the experiment; exit status.
    int run();

  private:
    void release_nodes();
    template <class Cycle> void stop_when_the_bus_fails(Cycle cycle);
    void check_encoders();
    void run_experiment();
    void read_bus();
    void send();
    void step(std::int64_t period);
    void close_bus(std::int64_t period);
    void say_stats() const;
    int end(const std::string &fault);

    RunConfig config_;
    bool injected_;
    RunSchedule schedule_;
    HostCycle cycle_;
    EncoderCheck encoder_check_;
    BenchBus bus_;
    std::unique_ptr<LcmReceiver> wrench_; ///< with a simulated arm
    LcmSender plant_;
    LcmSender observers_;
    Telemetry telemetry_;
    BusAccount account_;
    Pacer pacer_;
    RealtimeReport realtime_;
    hpmc_lcm::hand_wrench_t wrench_message_{};
    PeriodFrames from_nodes_{};
    PeriodFrames sensors_{}; ///< RPDO4 of bench_bridge, for the record
    HostCycleOutput output_;
    std::size_t frames_beyond_ = 0; ///< more in a cycle than the host takes
};

} // namespace hpmc
