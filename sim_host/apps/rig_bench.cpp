// rig_bench: how fast sil is, beside ODE alone: the same number of the same steps, in turns, in one
// process. Prints one JSON line.

#include <chrono>
#include <vector>

#include "apps/common_options.h"
#include "apps/sil_rig.h"

using namespace hpmc;

namespace {

template <class Work> double seconds(Work &&work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

} // namespace

int main(int argc, char **argv) {
    CLI::App app{"Speed of sil beside that of ODE alone."};
    ConfigOptions config_options;
    std::string log;
    int rounds = 7;
    config_options.add_to(app);
    app.add_option("--log", log, "LCM event log to write in each round (states)")->required();
    app.add_option("--rounds", rounds)->check(CLI::Range(1, 101));
    return run_app("rig_bench", app, argc, argv, [&] {
        const RunConfig config = config_options.load();
        const double ticks_per_s = 1.0 / kSyncPeriod_s;
        std::vector<double> sil_s;
        std::vector<double> ode_s;
        std::vector<double> ratio;
        std::int64_t periods = 0;
        std::int64_t steps = 0;
        for (int round = 0; round < rounds; ++round) {
            SilRig rig({.log = log, .level = LogLevel::states}, config);
            periods = rig.last_period() - rig.first_period();
            steps = periods * std::llround(kSyncPeriod_s / config.plant.step_s);
            sil_s.push_back(seconds([&] {
                for (std::int64_t p = rig.first_period(); p < rig.last_period() && rig.step(p);
                     ++p) {
                }
            }));
            if (!rig.fault().empty()) {
                throw LinkError(rig.fault());
            }
            ArmPlant plant(config.plant);
            plant.reset(start_pose_rad(config, 0));
            ode_s.push_back(seconds([&] { plant.advance_ode_alone(steps); }));
            ratio.push_back(sil_s.back() / ode_s.back());
        }
        const double simulated_s = static_cast<double>(periods) / ticks_per_s;
        std::printf("{\"simulated_s\": %.2f, \"ode_steps\": %lld, \"sil_s\": %.4f, "
                    "\"ode_alone_s\": %.4f, \"ratio\": %.3f, \"real_time_factor\": %.1f}\n",
                    simulated_s, static_cast<long long>(steps), median(sil_s), median(ode_s),
                    median(ratio), simulated_s / median(sil_s));
        return 0;
    });
}
