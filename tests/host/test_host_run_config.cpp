#include <doctest/doctest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <regex>
#include <sstream>
#include <string>
#include <unistd.h>
#include <vector>

#include "node_bench.h"

using namespace hpmc;

namespace {

/// A row of parameter_table().
struct Parameter {
    std::string key;
    std::string range; ///< "LOW to HIGH", or the words
    int numbers = 0;   ///< 0: one word of several
    double low = 0.0;
    double high = 0.0;
    bool whole = false;
};

std::vector<Parameter> parameters() {
    static const std::regex row(R"(^\| `([\w.]+)` \| (.*) \| .* \|$)");
    static const std::regex numbers(R"(^(?:(\d+) numbers, )?(\S+) to (\S+?)(, whole)?$)");
    std::vector<Parameter> result;
    std::istringstream table(parameter_table());
    for (std::string line; std::getline(table, line);) {
        std::smatch found;
        if (!std::regex_match(line, found, row)) {
            continue;
        }
        Parameter parameter{.key = found[1], .range = found[2]};
        if (std::smatch range; std::regex_match(parameter.range, range, numbers)) {
            parameter.numbers = range[1].matched ? std::stoi(range[1]) : 1;
            parameter.low = std::stod(range[2]);
            parameter.high = std::stod(range[3]);
            parameter.whole = range[4].matched;
            parameter.range = range[2].str() + " to " + range[3].str();
        }
        result.push_back(parameter);
    }
    return result;
}

/// What is said about an override, empty when it is taken.
std::string complaint(const std::vector<std::string> &overrides) {
    try {
        test::clock_config(overrides);
    } catch (const ConfigError &error) {
        return error.what();
    }
    return "";
}

std::string text_of(double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", value);
    return text;
}

std::string assignment(const Parameter &parameter, const std::string &number) {
    std::string value = number;
    if (parameter.numbers > 1) {
        value = "[" + number;
        for (int i = 1; i < parameter.numbers; ++i) {
            value += ", " + number;
        }
        value += "]";
    }
    return parameter.key + "=" + value;
}

bool contains(const std::string &text, const std::string &part) {
    return text.find(part) != std::string::npos;
}

/// A complaint of one line that begins with the key and says what is allowed.
void check_names_key_and_range(const std::string &override_text, const Parameter &parameter) {
    CAPTURE(override_text);
    const std::string said = complaint({override_text});
    CHECK(said.find(parameter.key + ": must be ") == 0);
    CHECK_FALSE(contains(said, "\n"));
    if (parameter.numbers > 0) {
        CHECK(contains(said, parameter.range));
    }
}

/// The experiment's file with the line of a key taken out.
std::string file_without(const std::string &key) {
    const std::string section = "[" + key.substr(0, key.find('.')) + "]";
    const std::string name = key.substr(key.find('.') + 1) + " = ";
    std::ifstream original(CLOCK_TOML);
    std::string here;
    std::string kept;
    for (std::string line; std::getline(original, line);) {
        here = line.rfind('[', 0) == 0 ? line : here;
        if (here != section || line.rfind(name, 0) != 0) {
            kept += line + "\n";
        }
    }
    return kept;
}

struct TemporaryFile {
    explicit TemporaryFile(const std::string &text) { std::ofstream(path) << text; }
    ~TemporaryFile() { std::remove(path.c_str()); }
    TemporaryFile(const TemporaryFile &) = delete;
    TemporaryFile &operator=(const TemporaryFile &) = delete;
    const std::string path = std::filesystem::temp_directory_path() /
                             ("run_config_" + std::to_string(getpid()) + ".toml");
};

std::string complaint_about_file(const std::string &text) {
    const TemporaryFile file(text);
    try {
        load_run_config({file.path}, {});
    } catch (const ConfigError &error) {
        return error.what();
    }
    return "";
}

} // namespace

TEST_CASE("the table of parameters is that of the experiment's file") {
    CHECK(parameters().size() >= 40);
    for (const Parameter &parameter : parameters()) {
        CAPTURE(parameter.key);
        CHECK(complaint_about_file(file_without(parameter.key)) == parameter.key + ": is missing");
    }
}

TEST_CASE("every key: a value out of range is refused with the key and the range") {
    for (const Parameter &parameter : parameters()) {
        if (parameter.numbers == 0) {
            continue;
        }
        const double step = parameter.whole ? 1.0 : 1e-6 * std::max(1.0, std::abs(parameter.high));
        for (const double value : {parameter.low - step, parameter.high + step}) {
            const std::string number =
                parameter.whole ? std::to_string(std::llround(value)) : text_of(value);
            check_names_key_and_range(assignment(parameter, number), parameter);
        }
        for (const char *number : {"nan", "inf", "-inf"}) {
            check_names_key_and_range(assignment(parameter, number), parameter);
        }
    }
}

TEST_CASE("every key: a value of a wrong type is refused with the key") {
    for (const Parameter &parameter : parameters()) {
        for (const char *value :
             {"'abc'", "true", "1979-05-27", "{ a = 1 }", "[]", "[1, 2, 3, 4]"}) {
            check_names_key_and_range(parameter.key + "=" + value, parameter);
        }
        if (parameter.whole) {
            check_names_key_and_range(parameter.key + "=10.5", parameter);
        }
        if (parameter.numbers > 1) {
            check_names_key_and_range(parameter.key + "=1.0", parameter);
            check_names_key_and_range(parameter.key + "=['a', 'b', 'c']", parameter);
        }
        if (parameter.numbers == 0) {
            CHECK(contains(complaint({parameter.key + "=other"}), "must be one of "));
        }
    }
}

TEST_CASE("every key: an unknown key beside it is refused, and the right one is named") {
    for (const Parameter &parameter : parameters()) {
        const std::string said = complaint({parameter.key + "x=1"});
        CAPTURE(said);
        CHECK(said.find("unknown key '" + parameter.key + "x'") == 0);
    }
    CHECK(complaint({"joint.rate_hz=1000"}) ==
          "unknown key 'joint.rate_hz', did you mean 'joint.rate_Hz'?");
    CHECK(contains(complaint({"elastic_bnad.saturation_m=1"}), "'elastic_band.saturation_m'"));
    CHECK(contains(complaint({"seed=1"}), "unknown key 'seed'"));
    CHECK(contains(complaint({"arm=3"}), "arm: must be a table"));
}

TEST_CASE("overrides that are no assignments") {
    for (const char *text : {"", "=", "=3", "experiment.seed", "experiment.seed 3", "a=1\nb=2"}) {
        CAPTURE(text);
        CHECK(contains(complaint({text}), "must be section.key=value"));
    }
    CHECK(contains(complaint({"experiment.seed="}), "experiment.seed: must be"));
    CHECK(
        contains(complaint({"experiment.seed=99999999999999999999"}), "experiment.seed: must be"));
}

TEST_CASE("words may come without quotation marks, and the last override wins") {
    CHECK(test::clock_config({"joint.phase_rule=error_growth"}).joint.phase_rule ==
          PhaseRule::error_growth);
    CHECK(test::clock_config({"joint.phase_rule='error_growth'"}).joint.phase_rule ==
          PhaseRule::error_growth);
    CHECK(test::clock_config({"experiment.seed=5", "experiment.seed=6"}).experiment.seed == 6);
    CHECK(test::clock_config({"experiment = { seed = 7 }"}).experiment.seed == 7);
}

TEST_CASE("a file over the experiment's own changes its keys only") {
    const TemporaryFile over("[joint]\nphase_rule = 'error_growth'\n\n[experiment]\nseed = 44\n");
    const RunConfig config = load_run_config({CLOCK_TOML, over.path}, {});
    CHECK(config.joint.phase_rule == PhaseRule::error_growth);
    CHECK(config.experiment.seed == 44);
    CHECK(config.joint.q_a_rad == test::clock_config().joint.q_a_rad);
    CHECK(load_run_config({CLOCK_TOML, over.path}, {"experiment.seed=45"}).experiment.seed == 45);
}

TEST_CASE("files that are missing, folders, or no TOML") {
    CHECK_THROWS_WITH_AS(load_run_config({"/no/such.toml"}, {}), "/no/such.toml: no such file",
                         ConfigError);
    CHECK_THROWS_WITH_AS(load_run_config({"/tmp"}, {}), "/tmp: is a folder, not a file",
                         ConfigError);
    const std::string said = complaint_about_file("[experiment]\nseed = 1\nseed = = 2\n");
    CHECK(contains(said, ", line 3: "));
    CHECK_FALSE(contains(said, "\n"));
}

TEST_CASE("the configuration as TOML gives the same configuration again") {
    for (const auto &overrides : std::vector<std::vector<std::string>>{
             {},
             {"experiment.radius_m=0.0712345678901234", "joint.rate_Hz=5000",
              "joint.phase_rule=error_growth", "dynamic_task.posture=optimal",
              "dynamic_task.direction=radial", "plant.step_s=0.0001", "experiment.seed=2147483647"},
             {"rig.sensors=injected", "arm.mass_kg=[1e-2, 0.1, 33.333333333333336]"}}) {
        const RunConfig config = test::clock_config(overrides);
        const std::string text = to_toml(config);
        const TemporaryFile file(text);
        const RunConfig again = load_run_config({file.path}, {});
        CHECK(to_toml(again) == text);
        CHECK(again.experiment.radius_m == config.experiment.radius_m);
        CHECK(again.plant.mass_kg == config.plant.mass_kg);
        CHECK(again.joint.phase_rule == config.joint.phase_rule);
        CHECK(again.sensors == config.sensors);
    }
}

TEST_CASE("keys that must go together") {
    const auto says = [](const std::vector<std::string> &overrides, const char *begin) {
        const std::string said = complaint(overrides);
        CAPTURE(said);
        CHECK(said.find(begin) == 0);
    };
    says({"joint.q_p_rad=0.006"}, "joint.q_p_rad: must lie between");
    says({"joint.q_p_rad=0.016"}, "joint.q_p_rad: must lie between");
    says({"region_of_attraction.force_max_N=[219, 500, 280]"},
         "region_of_attraction.force_max_N: ");
    says({"rig.sensors=injected", "joint.rate_Hz=5000"}, "rig.sensors: ");
    says({"schedule.setup_s=0.79"}, "schedule.setup_s: must be at least");
    says({"schedule.stop_s=0.15", "joint.ramp_s=0.11"}, "schedule.stop_s: must be at least");
    says({"bus.heartbeat_ms=500"}, "bus.heartbeat_timeout_ms: ");
    says({"plant.step_s=0.0003"}, "plant.step_s: must divide");
    says({"plant.step_s=0.001", "joint.rate_Hz=5000"}, "plant.step_s: must divide");
    says({"experiment.period_s=1.0005"}, "experiment.period_s: must be a whole number of ms");
    says({"schedule.setup_s=1.0001"}, "schedule.setup_s: must be a whole number of ms");
    says({"schedule.stop_s=0.2501"}, "schedule.stop_s: must be a whole number of ms");
    CHECK(complaint({"plant.step_s=0.001"}).empty());
    CHECK(complaint({"schedule.setup_s=0.81"}).empty());
}

TEST_CASE("targets out of reach are refused, with target, place and what can be reached") {
    const std::string far = complaint({"experiment.radius_m=0.27"});
    CAPTURE(far);
    CHECK(far.find("experiment.radius_m: target 1 at (0.570, 0.000) m is out of reach") == 0);
    CHECK(contains(far, "0.013 to 0.551 m"));
    const std::string home = complaint({"experiment.centre_m=[0.6, 0.3]"});
    CHECK(home.find("experiment.centre_m: target 0 at (0.600, 0.300) m is out of reach") == 0);
    // Only targets that are visited count; the eight is tried all along.
    CHECK(complaint({"experiment.radius_m=0.27", "experiment.reaches=16"}) == far);
    const std::string centre = "experiment.centre_m=[0.2, 0.3]";
    CHECK(complaint({centre, "experiment.radius_m=0.2", "experiment.reaches=2"}).empty());
    CHECK(contains(complaint({centre, "experiment.radius_m=0.2"}), "target 2 at"));
    CHECK(contains(complaint({"experiment.path=figure_of_eight", "experiment.centre_m=[0.5, 0.0]"}),
                   "m is out of reach"));
    // The wrist, not the hand, is what must be reached: the hand points away from it.
    CHECK(complaint({"experiment.centre_m=[0.1, 0.0]", "experiment.radius_m=0.05"}).empty());
}

TEST_CASE("a run begins in front of the wall") {
    const std::string behind = "wall.point_m: home (experiment.centre_m) must be at least 0.001 m";
    CHECK(complaint({"wall.surface=plane"}).empty());
    CHECK(complaint({"wall.surface=plane", "wall.normal_rad=0"}).find(behind) == 0);
    CHECK(complaint({"wall.surface=plane", "wall.point_m=[0.3005, 0.0]"}).find(behind) == 0);
    CHECK(complaint({"wall.surface=none", "wall.point_m=[0.3005, 0.0]"}).empty());
}
