#include "host/run_config.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <sstream>
#include <toml++/toml.h>

namespace hpmc {
namespace {

std::string number_text(double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.12g", value);
    if (std::strtod(text, nullptr) != value) {
        std::snprintf(text, sizeof text, "%.17g", value);
    }
    const bool integral = std::string(text).find_first_of(".en") == std::string::npos;
    return integral ? std::string(text) + ".0" : text;
}

std::string range_text(double low, double high) {
    char text[80];
    std::snprintf(text, sizeof text, "%.10g to %.10g", low, high);
    return text;
}

/// A named value of an enumeration.
template <class E> struct Choice {
    const char *name;
    E value;
};

template <class E> std::string choices_text(const std::vector<Choice<E>> &choices) {
    std::string text;
    for (const auto &choice : choices) {
        text += (text.empty() ? "" : " | ") + std::string(choice.name);
    }
    return text;
}

const std::vector<Choice<PhaseRule>> kPhaseRules{{"body_motion", PhaseRule::body_motion},
                                                 {"error_growth", PhaseRule::error_growth}};
const std::vector<Choice<Posture>> kPostures{{"paper", Posture::paper},
                                             {"optimal", Posture::optimal}};
const std::vector<Choice<TaskDirection>> kDirections{{"fixed", TaskDirection::fixed},
                                                     {"radial", TaskDirection::radial},
                                                     {"motion", TaskDirection::motion}};
const std::vector<Choice<Sensors>> kSensors{{"direct", Sensors::direct},
                                            {"injected", Sensors::injected}};
const std::vector<Choice<TargetPath>> kPaths{{"clock", TargetPath::clock},
                                             {"figure_of_eight", TargetPath::figure_of_eight}};
const std::vector<Choice<WallConfig::Surface>> kSurfaces{{"none", WallConfig::Surface::none},
                                                         {"plane", WallConfig::Surface::plane}};
const std::vector<Choice<std::int64_t>> kJointRates{{"1000", 1000}, {"5000", 5000}};

/// The one table: every key with its range and meaning. `V` reads, prints or lists.
template <class V> void describe(RunConfig &c, V &v) {
    v.section("experiment", "what the target of the hand does");
    v.choice("path", c.experiment.path, kPaths,
             "home to the targets of the clock and back, or an eight around home");
    v.vector("centre_m", c.experiment.centre_m, -0.6, 0.6, "m, home position of the hand (x, y)");
    v.number("radius_m", c.experiment.radius_m, 0.001, 0.3,
             "m, distance of the targets from home; half the height of the eight");
    v.number("period_s", c.experiment.period_s, 0.05, 3600,
             "s, a reach: a new target, or one eight");
    v.integer("reaches", c.experiment.reaches, 1, 2 * kClockTargets,
              "of a repetition: target 1, home, target 2, home ..., or so many eights");
    v.number("waypoint_s", c.experiment.waypoint_s, 0.001, 1,
             "s, how often the target moves on along the eight");
    v.integer("repetitions", c.experiment.repetitions, 1, 100000, "each from boot to stop");
    v.integer("seed", c.experiment.seed, 0, 2147483647, "of the start angles' offsets");

    v.section("arm", "the arm: upper arm, forearm, hand");
    v.vector("length_m", c.hpmc.arm.length_m, 0.01, 2, "m, length of each link");
    v.vector("mass_kg", c.plant.mass_kg, 0.01, 100, "kg, mass of each link (plant only)");
    v.number("joint_friction_Nm_s_rad", c.plant.joint_friction_Nm_s_rad, 0, 1,
             "N m s/rad, viscous (plant only)");

    v.section("plant", "the simulated arm");
    v.number("step_s", c.plant.step_s, 0.00005, 0.001, "s, step of ODE; divides the joint period");

    v.section("wall", "a plane that the hand may be pressed against; no friction");
    v.choice("surface", c.plant.wall.surface, kSurfaces, "whether there is a wall");
    v.vector("point_m", c.plant.wall.point_m, -1, 1, "m, a point of its surface (x, y)");
    v.number("normal_rad", c.plant.wall.normal_rad, -M_PI, M_PI,
             "rad, direction out of the wall, to the side where the hand may be");
    v.number("stiffness_N_m", c.plant.wall.stiffness_N_m, 1e3, 1e5, "N/m");
    v.number("damping_N_s_m", c.plant.wall.damping_N_s_m, 0, 1000, "N s/m");

    v.section("elastic_band", "layer 1");
    v.number("acceleration_max_m_s2", c.hpmc.elastic_band.acceleration_max_m_s2, 0.001, 50,
             "m/s^2, A");
    v.number("saturation_m", c.hpmc.elastic_band.saturation_m, 0.0001, 0.1, "m, x_b");

    v.section("dynamic_task", "layer 2");
    v.choice("posture", c.hpmc.dynamic_task.posture, kPostures,
             "closed form of the paper, or the minimiser of the paper's problem");
    v.choice("direction", c.hpmc.dynamic_task.direction, kDirections,
             "of the expected interaction W_t");
    v.number("w_t_rad", c.hpmc.dynamic_task.w_t_rad, -M_PI, M_PI, "rad, the fixed direction");
    v.number("joint_step_max_rad", c.hpmc.dynamic_task.joint_step_max_rad, 0.0001, 0.1,
             "rad per SYNC period, dQ_m");

    v.section("region_of_attraction", "layer 3: elbow, wrist, hand");
    v.vector("stiffness_N_m", c.hpmc.region_of_attraction.stiffness_N_m, 1, 1e6, "N/m, K0");
    v.number("saturation_m", c.hpmc.region_of_attraction.saturation_m, 0.001, 0.2, "m, x_b");
    v.vector("force_max_N", c.hpmc.region_of_attraction.force_max_N, 1, 1e5,
             "N, F_max, at least K0 x_b");

    v.section("joint_coordination", "layer 4");
    v.vector("torque_limit_Nm", c.hpmc.joint_coordination.torque_limit_Nm, 0.001, 32.767,
             "N m, TA, limit of each actuator");
    v.number("wrench_cutoff_Hz", c.hpmc.joint_coordination.wrench_cutoff_Hz, 20, 200,
             "Hz, low-pass of the measured wrench");

    v.section("joint", "the motor nodes: joint torque controllers");
    v.choice("rate_Hz", c.joint.rate_Hz, kJointRates, "Hz, joint loop");
    v.choice("phase_rule", c.joint.phase_rule, kPhaseRules, "of the FIC");
    v.number("q_a_rad", c.joint.q_a_rad, 0.0005, 0.5, "rad, error at the first plateau");
    v.number("q_p_rad", c.joint.q_p_rad, 0.0005, 0.5, "rad, end of the first plateau");
    v.number("q_b_rad", c.joint.q_b_rad, 0.0005, 0.5, "rad, error at the second plateau");
    v.number("delta_inc", c.joint.delta_inc, 0, 255, "increments, motion that counts as such");
    v.number("stall_time_s", c.joint.stall_time_s, 0.001, 1,
             "s, rest after which no motion counts");
    v.number("ramp_s", c.joint.ramp_s, 0.001, 5, "s, ramp of the output bound");
    v.integer("increments_per_revolution", c.joint.increments_per_revolution, 1024, 1 << 24,
              "of the encoders and of the commands");

    v.section("bus", "host and nodes");
    v.integer("pipeline", c.bus.pipeline, 1, 2, "SYNC periods from measurement to command");
    v.integer("command_delay_ms", c.bus.command_delay_ms, 0, 100, "ms, beyond the pipeline");
    v.integer("deadline_periods", c.bus.deadline_periods, 2, 1000,
              "SYNC periods without a command until a node stops");
    v.integer("heartbeat_ms", c.bus.heartbeat_ms, 10, 10000, "ms, of nodes and host");
    v.integer("heartbeat_timeout_ms", c.bus.heartbeat_timeout_ms, 20, 30000,
              "ms without a heartbeat until a node stops");

    v.section("schedule", "of a repetition");
    v.number("setup_s", c.schedule.setup_s, 0.5, 60, "s, boot to the first reach");
    v.number("approach_s", c.schedule.approach_s, 0.05, 30,
             "s, blend from the measured pose; as long again to full torque");
    v.number("approach_torque", c.schedule.approach_torque, 0.05, 1,
             "fraction of T_max during the approach");
    v.number("approach_tolerance_m", c.schedule.approach_tolerance_m, 0.0001, 0.05,
             "m, distance from home allowed at the first reach");
    v.number("stop_s", c.schedule.stop_s, 0.15, 10, "s, quick stop at the end");

    v.section("bench", "mode bench: a real bus, by the wall clock");
    v.integer("sync_Hz", c.bench.sync_Hz, 10, 1000,
              "Hz, SYNC on the wall clock; below 1000 the experiment runs in slow motion");
    v.vector("check_torque_Nm", c.bench.check_torque_Nm, 0.01, 10,
             "N m, largest torque of the encoder check");
    v.number("check_motion_rad", c.bench.check_motion_rad, 0.001, 0.1,
             "rad, motion that shows the sign of an encoder");
    v.number("check_motion_max_rad", c.bench.check_motion_max_rad, 0.002, 0.5,
             "rad, motion that ends the encoder check");
    v.number("check_tolerance_rad", c.bench.check_tolerance_rad, 0.01, 3,
             "rad, distance of the measured angles from the home posture");

    v.section("rig", "how the nodes see the arm");
    v.choice("sensors", c.sensors, kSensors, "encoder and motor direct, or by RPDO4 and TPDO1");
}

class Reader {
  public:
    explicit Reader(const toml::table &table) : table_(table) {}

    void section(const char *name, const char *) {
        section_ = name;
        const auto *node = table_.get(name);
        if (node != nullptr && !node->is_table()) {
            throw ConfigError(std::string(name) + ": must be a table");
        }
    }

    void number(const char *key, double &value, double low, double high, const char *) {
        value = checked(key, find(key).value<double>(), low, high, "a number");
    }

    void integer(const char *key, std::int64_t &value, double low, double high, const char *) {
        std::optional<double> whole;
        if (const auto found = find(key).value_exact<std::int64_t>()) {
            whole = static_cast<double>(*found);
        }
        value = static_cast<std::int64_t>(checked(key, whole, low, high, "a whole number"));
    }

    template <int N>
    void vector(const char *key, Eigen::Matrix<double, N, 1> &value, double low, double high,
                const char *) {
        const auto *array = find(key).as_array();
        if (array == nullptr || array->size() != static_cast<std::size_t>(N)) {
            throw ConfigError(full(key) + ": must be an array of " + std::to_string(N) +
                              " numbers, each " + range_text(low, high));
        }
        for (int i = 0; i < N; ++i) {
            value[i] = checked(key, (*array)[static_cast<std::size_t>(i)].value<double>(), low,
                               high, "an array of numbers");
        }
    }

    template <class E>
    void choice(const char *key, E &value, const std::vector<Choice<E>> &choices, const char *) {
        auto text = find(key).value_exact<std::string>();
        if (const auto whole = find(key).value_exact<std::int64_t>()) {
            text = std::to_string(*whole);
        }
        for (const auto &choice : choices) {
            if (text && *text == choice.name) {
                value = choice.value;
                return;
            }
        }
        throw ConfigError(full(key) + ": must be one of " + choices_text(choices));
    }

    /// Every key of the file must have been asked for.
    void reject_unknown() const {
        for (const auto &[section, node] : table_) {
            const std::string name(section.str());
            const auto *table = node.as_table();
            if (table == nullptr) {
                throw ConfigError("unknown key '" + name + "': keys are written section.key, see " +
                                  "docs/configuration.md");
            }
            for (const auto &[key, value] : *table) {
                const std::string text = name + "." + std::string(key.str());
                if (known_.count(text) == 0) {
                    throw ConfigError("unknown key '" + text + "'" + nearest(text));
                }
            }
        }
    }

  private:
    std::string full(const char *key) const { return section_ + "." + key; }

    toml::node_view<const toml::node> find(const char *key) {
        known_.insert(full(key));
        const auto view = table_[section_][key];
        if (!view) {
            throw ConfigError(full(key) + ": is missing");
        }
        return view;
    }

    double checked(const char *key, std::optional<double> value, double low, double high,
                   const char *kind) const {
        const double number = value.value_or(std::numeric_limits<double>::quiet_NaN());
        if (!(number >= low && number <= high)) {
            throw ConfigError(full(key) + ": must be " + kind + ", " + range_text(low, high));
        }
        return number;
    }

    /// A hint at the key that was probably meant: the one with the most letters in common order.
    std::string nearest(const std::string &text) const {
        std::string best;
        std::size_t best_score = 0;
        for (const std::string &candidate : known_) {
            std::size_t score = 0;
            std::size_t at = 0;
            for (const char letter : text) {
                const std::size_t found = candidate.find(letter, at);
                if (found != std::string::npos) {
                    ++score;
                    at = found + 1;
                }
            }
            if (score > best_score) {
                best_score = score;
                best = candidate;
            }
        }
        return 2 * best_score > text.size() ? ", did you mean '" + best + "'?" : "";
    }

    const toml::table &table_;
    std::string section_;
    std::set<std::string> known_;
};

class TomlWriter {
  public:
    void section(const char *name, const char *) {
        out_ << (out_.tellp() > 0 ? "\n" : "") << '[' << name << "]\n";
    }
    void number(const char *key, double value, double, double, const char *meaning) {
        line(key, number_text(value), meaning);
    }
    void integer(const char *key, std::int64_t value, double, double, const char *meaning) {
        line(key, std::to_string(value), meaning);
    }
    template <int N>
    void vector(const char *key, const Eigen::Matrix<double, N, 1> &value, double, double,
                const char *meaning) {
        std::string text;
        for (int i = 0; i < N; ++i) {
            text += (i > 0 ? ", " : "") + number_text(value[i]);
        }
        line(key, "[" + text + "]", meaning);
    }
    template <class E>
    void choice(const char *key, E value, const std::vector<Choice<E>> &choices,
                const char *meaning) {
        for (const auto &choice : choices) {
            if (choice.value == value) {
                const bool numeric = std::is_arithmetic_v<E>;
                line(key, numeric ? choice.name : "\"" + std::string(choice.name) + "\"", meaning);
            }
        }
    }
    std::string text() const { return out_.str(); }

  private:
    void line(const char *key, const std::string &value, const char *meaning) {
        out_ << key << " = " << value << "  # " << meaning << '\n';
    }
    std::ostringstream out_;
};

class TableWriter {
  public:
    TableWriter() { out_ << "| key | range | meaning |\n| --- | --- | --- |\n"; }
    void section(const char *name, const char *meaning) {
        section_ = name;
        out_ << "| **" << name << "** | | " << meaning << " |\n";
    }
    void number(const char *key, double, double low, double high, const char *meaning) {
        row(key, range_text(low, high), meaning);
    }
    void integer(const char *key, std::int64_t, double low, double high, const char *meaning) {
        row(key, range_text(low, high) + ", whole", meaning);
    }
    template <int N>
    void vector(const char *key, const Eigen::Matrix<double, N, 1> &, double low, double high,
                const char *meaning) {
        row(key, std::to_string(N) + " numbers, " + range_text(low, high), meaning);
    }
    template <class E>
    void choice(const char *key, E, const std::vector<Choice<E>> &choices, const char *meaning) {
        std::string text;
        for (const auto &choice : choices) {
            text += (text.empty() ? "" : ", ") + std::string(choice.name);
        }
        row(key, text, meaning);
    }
    std::string text() const { return out_.str(); }

  private:
    void row(const char *key, const std::string &range, const char *meaning) {
        out_ << "| `" << section_ << '.' << key << "` | " << range << " | " << meaning << " |\n";
    }
    std::string section_;
    std::ostringstream out_;
};

void merge(toml::table &base, const toml::table &over) {
    for (const auto &[key, node] : over) {
        const auto *table = node.as_table();
        auto *existing = base.get_as<toml::table>(key.str());
        if (table != nullptr && existing != nullptr) {
            merge(*existing, *table);
        } else {
            base.insert_or_assign(key.str(), node);
        }
    }
}

toml::table parse_file(const std::string &path) {
    if (!std::filesystem::exists(path)) {
        throw ConfigError(path + ": no such file");
    }
    if (std::filesystem::is_directory(path)) {
        throw ConfigError(path + ": is a folder, not a file");
    }
    try {
        return toml::parse_file(path);
    } catch (const toml::parse_error &error) {
        throw ConfigError(path + ", line " + std::to_string(error.source().begin.line) + ": " +
                          std::string(error.description()));
    }
}

/// `key=value` as TOML; a value that is no TOML is taken as a string (phase_rule=error_growth).
toml::table parse_override(const std::string &text) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0 || text.find('\n') != std::string::npos) {
        throw ConfigError("'" + text + "': must be section.key=value");
    }
    try {
        return toml::parse(text);
    } catch (const toml::parse_error &) {
    }
    try {
        return toml::parse(text.substr(0, equals + 1) + "'" + text.substr(equals + 1) + "'");
    } catch (const toml::parse_error &) {
        throw ConfigError("'" + text + "': must be section.key=value");
    }
}

void require(bool ok, const char *what) {
    if (!ok) {
        throw ConfigError(what);
    }
}

void require_divides(double step_s, double period_s) {
    const double ratio = period_s / step_s;
    require(std::abs(ratio - std::round(ratio)) < 1e-9,
            "plant.step_s: must divide the joint period (1/joint.rate_Hz)");
}

void check_whole_periods(double seconds, const char *key) {
    require(std::abs(seconds * 1000.0 - std::round(seconds * 1000.0)) < 1e-6,
            (std::string(key) + ": must be a whole number of ms").c_str());
}

/// Targets of the hand that are tried: home first, then around the clock or along the eight.
std::vector<Eigen::Vector2d> targets_m(const ExperimentConfig &experiment) {
    constexpr int kEightSamples = 64;
    std::vector<Eigen::Vector2d> targets{experiment.centre_m};
    const bool clock = experiment.path == TargetPath::clock;
    const int count = clock ? static_cast<int>(experiment.reaches + 1) / 2 : kEightSamples;
    for (int i = 0; i < count; ++i) {
        const double angle = 2.0 * M_PI * i / (clock ? kClockTargets : kEightSamples);
        const double x = clock ? std::cos(angle) : std::sin(2.0 * angle) / 2.0;
        targets.emplace_back(experiment.centre_m +
                             experiment.radius_m * Eigen::Vector2d(x, std::sin(angle)));
    }
    return targets;
}

void check_targets(const RunConfig &c) {
    const PlanarArm arm(c.hpmc.arm);
    const std::vector<Eigen::Vector2d> targets = targets_m(c.experiment);
    for (std::size_t target = 0; target < targets.size(); ++target) {
        const Eigen::Vector2d &x_m = targets[target];
        const Eigen::Vector3d q_rad = arm.inverse(x_m, c.hpmc.dynamic_task.w_t_rad).q_rad;
        DynamicTask task(c.hpmc.dynamic_task, c.hpmc.arm);
        task.reset(q_rad);
        if (task.step(x_m, Eigen::Vector2d::Zero(), q_rad).saturated) {
            char text[160];
            std::snprintf(text, sizeof text,
                          "experiment.%s: target %zu at (%.3f, %.3f) m is out of reach: the wrist "
                          "must lie %.3f to %.3f m from the shoulder",
                          target == 0 ? "centre_m" : "radius_m", target, x_m.x(), x_m.y(),
                          std::abs(c.hpmc.arm.length_m[0] - c.hpmc.arm.length_m[1]),
                          c.hpmc.arm.length_m[0] + c.hpmc.arm.length_m[1]);
            throw ConfigError(text);
        }
    }
}

/// Home must be on the free side of the wall: a run begins there, at rest and without a force.
void check_wall(const RunConfig &c) {
    const WallConfig &wall = c.plant.wall;
    const Eigen::Vector2d normal(std::cos(wall.normal_rad), std::sin(wall.normal_rad));
    require(!wall.present() || (c.experiment.centre_m - wall.point_m).dot(normal) >= 0.001,
            "wall.point_m: home (experiment.centre_m) must be at least 0.001 m in front of the "
            "wall, on the side that wall.normal_rad points to");
}

void check(const RunConfig &c) {
    require(c.joint.q_a_rad <= c.joint.q_p_rad && c.joint.q_p_rad < c.joint.q_b_rad,
            "joint.q_p_rad: must lie between joint.q_a_rad and joint.q_b_rad");
    for (int i = 0; i < 3; ++i) {
        require(c.hpmc.region_of_attraction.force_max_N[i] >=
                    c.hpmc.region_of_attraction.stiffness_N_m[i] *
                        c.hpmc.region_of_attraction.saturation_m,
                "region_of_attraction.force_max_N: must be at least stiffness_N_m x saturation_m");
    }
    require(c.sensors == Sensors::direct || c.joint.rate_Hz == 1000,
            "rig.sensors: injected sensors come once per SYNC, so joint.rate_Hz must be 1000");
    require(2.0 * c.schedule.approach_s + c.joint.ramp_s + 0.3 <= c.schedule.setup_s,
            "schedule.setup_s: must be at least 2 approach_s + joint.ramp_s + 0.3");
    require(c.joint.ramp_s + 0.05 <= c.schedule.stop_s,
            "schedule.stop_s: must be at least joint.ramp_s + 0.05");
    require(c.bus.heartbeat_timeout_ms > c.bus.heartbeat_ms,
            "bus.heartbeat_timeout_ms: must be above bus.heartbeat_ms");
    const std::int64_t bench_ticks = c.joint.rate_Hz / c.bench.sync_Hz;
    require(1000000 % c.bench.sync_Hz == 0, "bench.sync_Hz: must divide 1000000");
    require(bench_ticks * c.bench.sync_Hz == c.joint.rate_Hz,
            "bench.sync_Hz: must divide joint.rate_Hz");
    require(c.bench.check_motion_rad < c.bench.check_motion_max_rad,
            "bench.check_motion_max_rad: must be above bench.check_motion_rad");
    require_divides(c.plant.step_s, 1.0 / static_cast<double>(c.joint.rate_Hz));
    check_whole_periods(c.experiment.period_s, "experiment.period_s");
    check_whole_periods(c.experiment.waypoint_s, "experiment.waypoint_s");
    check_whole_periods(c.schedule.setup_s, "schedule.setup_s");
    check_whole_periods(c.schedule.stop_s, "schedule.stop_s");
    check_targets(c);
    check_wall(c);
}

} // namespace

RunConfig load_run_config(const std::vector<std::string> &files,
                          const std::vector<std::string> &overrides) {
    toml::table table;
    for (const std::string &file : files) {
        merge(table, parse_file(file));
    }
    for (const std::string &text : overrides) {
        merge(table, parse_override(text));
    }
    RunConfig config{};
    Reader reader(table);
    describe(config, reader);
    reader.reject_unknown();
    config.plant.length_m = config.hpmc.arm.length_m;
    check(config);
    return config;
}

std::string to_toml(const RunConfig &config) {
    RunConfig copy = config;
    TomlWriter writer;
    describe(copy, writer);
    return writer.text();
}

std::string parameter_table() {
    RunConfig config{};
    TableWriter writer;
    describe(config, writer);
    return writer.text();
}

} // namespace hpmc
