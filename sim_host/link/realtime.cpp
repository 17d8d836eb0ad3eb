#include "link/realtime.h"

#include <cerrno>
#include <cstring>
#include <sched.h>
#include <sys/mman.h>

namespace hpmc {
namespace {

constexpr int kPriority = 50; ///< below the interrupt threads of a real-time kernel's drivers

} // namespace

RealtimeReport become_realtime() {
    RealtimeReport report;
    sched_param parameter{};
    parameter.sched_priority = kPriority;
    report.scheduling = sched_setscheduler(0, SCHED_FIFO, &parameter) == 0
                            ? "SCHED_FIFO " + std::to_string(kPriority)
                            : std::string("SCHED_OTHER: ") + std::strerror(errno);
    // MCL_FUTURE only where MCL_CURRENT succeeds: under a limit it would make allocations fail.
    report.memory = mlockall(MCL_CURRENT) == 0 && mlockall(MCL_CURRENT | MCL_FUTURE) == 0
                        ? "locked"
                        : std::string("not locked: ") + std::strerror(errno);
    return report;
}

std::string to_json(const RealtimeReport &report) {
    return "\"scheduling\": \"" + report.scheduling + "\", \"memory\": \"" + report.memory + "\"";
}

} // namespace hpmc
