// sil: the whole rig in one process (sil_rig.h), as a program.

#include "apps/common_options.h"
#include "apps/sil_rig.h"
#include "host/progress.h"
#include "link/pacer.h"
#include "port/posix/stop_signal.h"

using namespace hpmc;

namespace {

int run(SilRig &rig, bool realtime) {
    Pacer pacer(kSyncPeriod_us * 1000, Pacer::WhenLate::catch_up);
    std::int64_t period = rig.first_period();
    bool going_on = true;
    while (going_on && period < rig.last_period()) {
        if (stop_signal_raised()) {
            rig.request_stop();
        }
        if (realtime) {
            pacer.wait();
        }
        going_on = rig.step(period);
        say_progress(period, rig.schedule_point());
        ++period;
    }
    rig.flush();
    std::printf("STATS {\"frames\": %lld, \"frames_lost\": %zu, \"load_typical_percent\": %.2f, "
                "\"messages\": %lld, \"periods\": %lld, \"overruns\": %lld, "
                "\"lateness_max_us\": %lld, \"outside_targets\": %lld, "
                "\"outside_targets_refused\": %lld, \"outside_targets_dropped\": %lld}\n",
                static_cast<long long>(rig.account().frames()), rig.frames_lost(),
                rig.account().load_typical_percent(), static_cast<long long>(rig.messages()),
                static_cast<long long>(period - rig.first_period()),
                static_cast<long long>(pacer.overruns()),
                static_cast<long long>(pacer.lateness_max_us()),
                static_cast<long long>(rig.host().outside_targets()),
                static_cast<long long>(rig.host().outside_targets_refused()),
                static_cast<long long>(rig.targets_dropped()));
    if (!rig.fault().empty()) {
        std::fprintf(stderr, "sil: %s\n", rig.fault().c_str());
    }
    return going_on ? 0 : kExitRunEnded;
}

SilRig make_rig(const SilOptions &options, const RunConfig &config,
                const std::vector<std::string> &nodes) {
    if (nodes.empty()) {
        return SilRig(options, config);
    }
    if (nodes.size() != kJoints) {
        throw ConfigError("--node: one for each of the three nodes, or none");
    }
    if (config.sensors != Sensors::injected) {
        throw ConfigError("--node: needs rig.sensors = injected");
    }
    return SilRig(options, config, emulated_nodes(nodes), "emulated");
}

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"The rig in one process."};
    ConfigOptions config_options;
    SilOptions options;
    std::vector<std::string> nodes;
    config_options.add_to(app);
    app.add_option("--log", options.log, "LCM event log to write; none when left out");
    add_log_level(app, options.level);
    app.add_option("--first-repetition", options.first_repetition)
        ->check(CLI::Range(std::int64_t{0}, std::int64_t{100000}));
    app.add_option("--repetitions", options.repetitions)
        ->check(CLI::Range(std::int64_t{0}, std::int64_t{100000}));
    app.add_option("--lcm-url", options.lcm_url,
                   "publish telemetry and ARM_STATE there, take targets from there");
    app.add_option("--targets", options.targets,
                   "LCM event log: its targets from outside act again, at their time");
    bool realtime = false;
    app.add_flag("--realtime", realtime, "held to the wall clock");
    app.add_option("--node", nodes,
                   "node at the other end of a line, instead of one in this process: "
                   "slcan:tcp:HOST:PORT or slcan:DEVICE; three times, in order");
    return run_app("sil", app, argc, argv, [&] {
        const RunConfig config = config_options.load();
        stop_signal_install(false);
        SilRig rig = make_rig(options, config, nodes);
        return run(rig, realtime);
    });
}
