/**
 * The configuration of a run: every parameter of an experiment's TOML file, with its range.
 *
 * One table (run_config.cpp) names each key, its range and its unit; reading, checking, printing
 * and the documentation all go through it.
 */
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "hpmc/hpmc_controller.h"
#include "plant/arm_plant.h"

namespace hpmc {

/// Something is wrong with the configuration: one line with the key and the allowed range.
struct ConfigError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Number of targets on the clock.
constexpr int kClockTargets = 8;

/// What the target of the hand does.
enum class TargetPath {
    clock,           ///< jumps from home to the targets of the clock and back
    figure_of_eight, ///< runs along an eight around home
};

struct ExperimentConfig {
    TargetPath path;
    Eigen::Vector2d centre_m;
    double radius_m;
    double period_s;      ///< of a reach
    std::int64_t reaches; ///< of a repetition
    double waypoint_s;    ///< from one target to the next on a path
    std::int64_t repetitions;
    std::int64_t seed;
};

/// Joint controllers: object 2100h and 2101h of the nodes.
struct JointConfig {
    std::int64_t rate_Hz;
    PhaseRule phase_rule;
    double q_a_rad;
    double q_p_rad;
    double q_b_rad;
    double delta_inc;
    double stall_time_s;
    double ramp_s;
    std::int64_t increments_per_revolution;
};

struct BusConfig {
    std::int64_t pipeline;         ///< 1 or 2 cycles from measurement to command
    std::int64_t command_delay_ms; ///< on top of the pipeline
    std::int64_t deadline_periods; ///< 1400h:05
    std::int64_t heartbeat_ms;     ///< 1017h of the nodes and of the host
    std::int64_t heartbeat_timeout_ms;
};

struct ScheduleConfig {
    double setup_s;         ///< boot, configuration, enabling and approach fit into this
    double approach_s;      ///< from the measured pose to the first desired one
    double approach_torque; ///< fraction of T_max during the approach
    double approach_tolerance_m;
    double stop_s; ///< quick stop, disabling
};

/// On a real bus, by the wall clock.
struct BenchConfig {
    std::int64_t sync_Hz;
    Eigen::Vector3d check_torque_Nm; ///< of the encoder check, largest
    double check_motion_rad;         ///< that shows an encoder's sign
    double check_motion_max_rad;     ///< more than this ends the check
    double check_tolerance_rad;      ///< measured angles from the home posture
};

enum class Sensors { direct, injected };

struct RunConfig {
    ExperimentConfig experiment;
    HpmcConfig hpmc;
    ArmPlantConfig plant;
    JointConfig joint;
    BusConfig bus;
    ScheduleConfig schedule;
    BenchConfig bench;
    Sensors sensors;

    int joint_ticks() const { return static_cast<int>(joint.rate_Hz / 1000); }
};

/// Reads `files` over one another, then the `key=value` overrides, and checks everything, the reach
/// of the targets included. Throws ConfigError.
RunConfig load_run_config(const std::vector<std::string> &files,
                          const std::vector<std::string> &overrides);

/// The configuration as TOML, complete; load_run_config of it gives the same configuration.
std::string to_toml(const RunConfig &config);

/// Key, range and meaning of every parameter as a Markdown table.
std::string parameter_table();

} // namespace hpmc
