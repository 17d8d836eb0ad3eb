/**
 * What every process of the rig takes on its command line, and how it ends.
 */
#pragma once

#include <CLI/CLI.hpp>
#include <exception>
#include <string>
#include <vector>

#include "host/run_config.h"
#include "host/telemetry.h"

namespace hpmc {

/// Exit statuses: 0 done, 2 bad input, 3 the run ended early.
constexpr int kExitUsage = 2;
constexpr int kExitRunEnded = 3;

struct ConfigOptions {
    std::vector<std::string> files;
    std::vector<std::string> overrides;

    void add_to(CLI::App &app) {
        app.add_option("--config", files, "TOML files, each over the one before")->required();
        app.add_option("--set", overrides, "section.key=value, over the files")
            ->take_all()
            ->delimiter('\0');
    }
    RunConfig load() const { return load_run_config(files, overrides); }
};

inline void add_log_level(CLI::App &app, LogLevel &level) {
    static const std::vector<std::pair<std::string, LogLevel>> names{{"full", LogLevel::full},
                                                                     {"states", LogLevel::states}};
    app.add_option("--log-level", level, "full | states")
        ->transform(CLI::CheckedTransformer(names));
}

/// Parses the command line, runs `body`, and turns what goes wrong into one line and an exit
/// status.
template <class Body>
int run_app(const char *name, CLI::App &app, int argc, char **argv, Body &&body) {
    try {
        app.parse(argc, argv);
        return body();
    } catch (const CLI::ParseError &error) {
        return app.exit(error) == 0 ? 0 : kExitUsage;
    } catch (const ConfigError &error) {
        std::fprintf(stderr, "%s: %s\n", name, error.what());
        return kExitUsage;
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s: %s\n", name, error.what());
        return kExitRunEnded;
    }
}

} // namespace hpmc
