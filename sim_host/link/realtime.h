/**
 * Real-time scheduling and locked memory for a process of the wall-clock loop, where the system
 * allows it; what it does not allow is reported, not fatal.
 */
#pragma once

#include <string>

namespace hpmc {

struct RealtimeReport {
    std::string scheduling; ///< "SCHED_FIFO 50", or "SCHED_OTHER: " and why
    std::string memory;     ///< "locked", or "not locked: " and why
};

/// All processes of the loop share one priority, so that none keeps another from its messages.
RealtimeReport become_realtime();

/// As the inside of a JSON object.
std::string to_json(const RealtimeReport &report);

} // namespace hpmc
