#include "host/bus_account.h"

#include "link/can_load.h"

namespace hpmc {
namespace {

constexpr double kBitsPerPeriod = 1000.0;                   ///< 1 Mbit/s, 1 ms
constexpr int kCyclicFrames = 2 * static_cast<int>(kNodes); ///< RPDO1 and TPDO1

} // namespace

void BusAccount::add(std::int64_t period, const PeriodFrames &from_nodes,
                     const HostCycleOutput &from_host) {
    frames_ += static_cast<std::int64_t>(from_nodes.count + from_host.frame_count);
    if (period % kSamplePeriods != 0 || from_host.frame_count <= kNodes) {
        return;
    }
    ++sampled_periods_;
    for (std::size_t i = 0; i < from_nodes.count; ++i) {
        sampled_bits_ += can_bits_exact(from_nodes.frames[i]);
    }
    for (std::size_t i = 0; i < from_host.frame_count; ++i) {
        sampled_bits_ += can_bits_exact(from_host.frames[i]);
    }
}

double BusAccount::load_typical_percent() const {
    return sampled_periods_ == 0 ? 0.0
                                 : 100.0 * static_cast<double>(sampled_bits_) /
                                       (kBitsPerPeriod * static_cast<double>(sampled_periods_));
}

double bus_load_worst_percent(Sensors sensors) {
    const int injected = sensors == Sensors::injected ? static_cast<int>(kNodes) : 0;
    const int bits = can_bits_worst(1) + (kCyclicFrames + injected) * can_bits_worst(8);
    return 100.0 * bits / kBitsPerPeriod;
}

} // namespace hpmc
