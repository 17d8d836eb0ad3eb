// hpmc_config: checks a configuration and prints it complete, as TOML, or prints its description.

#include <iostream>

#include "apps/common_options.h"
#include "host/bus_account.h"
#include "host/run_schedule.h"

using namespace hpmc;

int main(int argc, char **argv) {
    CLI::App app{"Checks a configuration and prints it complete."};
    ConfigOptions options;
    options.add_to(app);
    bool describe = false;
    app.add_flag("--describe", describe, "print every key with range and meaning, as Markdown");
    return run_app("configuration", app, argc, argv, [&] {
        const RunConfig config = options.load();
        const RunSchedule schedule(config);
        std::cout << (describe ? parameter_table() : to_toml(config));
        if (!describe) {
            std::cout << "\n# periods_per_repetition = " << schedule.periods_per_repetition()
                      << "\n# joint_ticks = " << config.joint_ticks()
                      << "\n# bus_load_worst_percent = " << bus_load_worst_percent(config.sensors)
                      << '\n';
        }
        return 0;
    });
}
