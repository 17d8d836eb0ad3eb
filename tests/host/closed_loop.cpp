#include "closed_loop.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "hpmc/hpmc_controller.h"
#include "plant/arm_plant.h"

using namespace hpmc;

namespace {

constexpr double increment_rad = 2.0 * M_PI / 65536.0;
constexpr int settle_ticks = 1000;
constexpr int reach_ticks = 1000;

Eigen::Vector3d on_grid(const Eigen::Vector3d &value, double unit) {
    return unit * (value / unit).array().round().matrix();
}

/// Two plateaus: T_1 at small errors, T_2 at large ones.
double torque_profile_Nm(double excursion_rad, double tau_d_Nm, double tau_max_Nm) {
    constexpr double q_a = 0.0075;
    constexpr double q_p = 0.009;
    constexpr double q_b = 0.016;
    const double t_1 = std::min(std::abs(tau_d_Nm), tau_max_Nm);
    if (excursion_rad <= q_a) {
        return t_1 * excursion_rad / q_a;
    }
    if (excursion_rad <= q_p) {
        return t_1;
    }
    return excursion_rad < q_b ? t_1 + (tau_max_Nm - t_1) * (excursion_rad - q_p) / (q_b - q_p)
                               : tau_max_Nm;
}

class ReachMeter {
  public:
    void add(const HpmcOutput &planned, const ArmPlantState &executed) {
        add_speed(planned_, planned.v_d_m_s.norm());
        add_speed(executed_, executed.hand_m_s.norm());
        position_ += (executed.hand_m - planned.x_d_m).squaredNorm();
        velocity_ += (executed.hand_m_s - planned.v_d_m_s).squaredNorm();
    }

    test::ReachFigures figures() const {
        return {planned_.peak * reach_ticks / planned_.sum,
                executed_.peak * reach_ticks / executed_.sum, std::sqrt(position_ / reach_ticks),
                std::sqrt(velocity_ / reach_ticks)};
    }

  private:
    struct Speed {
        double peak = 0.0;
        double sum = 0.0;
    };

    static void add_speed(Speed &speed, double value) {
        speed.peak = std::max(speed.peak, value);
        speed.sum += value;
    }

    Speed planned_;
    Speed executed_;
    double position_ = 0.0;
    double velocity_ = 0.0;
};

/// One tick after the other, from rest at a pose.
class ClosedLoop {
  public:
    ClosedLoop(PhaseRule phase_rule, const Eigen::Vector3d &start_rad, const WallConfig &wall)
        : plant_([&] {
              ArmPlantConfig config;
              config.wall = wall;
              return config;
          }()),
          host_(HpmcConfig{}), fic_{joint_fic(phase_rule), joint_fic(phase_rule),
                                    joint_fic(phase_rule)},
          q_before_(start_rad) {
        plant_.reset(start_rad);
        for (std::size_t i = 0; i < 3; ++i) {
            fic_[i].reset(start_rad[static_cast<Eigen::Index>(i)]);
        }
        host_.reset(PlanarArm(PlanarArmConfig{}).link_ends(start_rad)[hand], start_rad);
    }

    /// wrench_gain: what the host gets to see of the measured wrench; 1 in the rig.
    void step(const Eigen::Vector2d &target_m, double wrench_gain) {
        state = plant_.state();
        const Eigen::Vector3d q = on_grid(state.q_rad, increment_rad);
        command = host_.step({target_m, q_before_, wrench_gain * state.wrench_N});
        q_before_ = q;

        const Eigen::Vector3d error = on_grid(command.q_d_rad, increment_rad) - q;
        const Eigen::Vector3d tau_d = on_grid(command.tau_d_Nm, 1e-3);
        const Eigen::Vector3d tau_max = on_grid(command.tau_max_Nm, 1e-3);
        for (std::size_t i = 0; i < 3; ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            const double profile =
                torque_profile_Nm(std::abs(error[row]), tau_d[row], tau_max[row]);
            tau_Nm[row] = fic_[i].step(error[row], q[row], profile);
        }
        const Eigen::Vector3d limit_Nm(30.0, 20.0, 5.0);
        tau_Nm = on_grid(tau_Nm.cwiseMin(limit_Nm).cwiseMax(-limit_Nm), 1e-3);
        plant_.advance(tau_Nm, 1e-3);
    }

    // of the last step
    ArmPlantState state{};
    HpmcOutput command;
    Eigen::Vector3d tau_Nm = Eigen::Vector3d::Zero();

  private:
    static Fic joint_fic(PhaseRule phase_rule) {
        FicConfig config;
        config.phase_rule = phase_rule;
        config.delta = increment_rad / 2.0;
        return Fic{config};
    }

    ArmPlant plant_;
    HpmcController host_;
    std::array<Fic, 3> fic_;
    Eigen::Vector3d q_before_;
};

const Eigen::Vector2d home(0.3, 0.0);

Eigen::Vector3d home_rad() {
    return on_grid(PlanarArm(PlanarArmConfig{}).inverse(home, 155.0 * M_PI / 180.0).q_rad,
                   increment_rad);
}

} // namespace

test::ClosedLoopRun test::run_clock(PhaseRule phase_rule, const Eigen::Vector3d &offset_inc) {
    const Eigen::Vector3d start = home_rad() + increment_rad * offset_inc;
    ClosedLoop loop(phase_rule, start, WallConfig{});
    ClosedLoopRun run;
    run.q_start_rad = start;
    ReachMeter meter;
    for (int tick = 0; tick < settle_ticks + 16 * reach_ticks; ++tick) {
        const int reach = tick < settle_ticks ? -1 : (tick - settle_ticks) / reach_ticks;
        Eigen::Vector2d target = home;
        if (reach >= 0 && reach % 2 == 0) {
            const double angle = reach / 2 * M_PI / 4.0;
            target += 0.1 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        }
        loop.step(target, 1.0);
        run.torques_Nm.push_back(loop.tau_Nm);
        if (reach >= 0) {
            meter.add(loop.command, loop.state);
            if (tick % reach_ticks == reach_ticks - 1) {
                run.reaches.push_back(meter.figures());
                meter = ReachMeter{};
            }
        }
    }
    return run;
}

test::Press test::press_wall(const WallConfig &wall, const Eigen::Vector2d &target_m,
                             double wrench_gain) {
    constexpr int press_ticks = 2000;
    constexpr int rest_ticks = 500;
    const Eigen::Vector2d into_wall(-std::cos(wall.normal_rad), -std::sin(wall.normal_rad));
    ClosedLoop loop(PhaseRule::body_motion, home_rad(), wall);
    Press press{};
    int ticks_touching = 0;
    bool touched_before = false;
    for (int tick = 0; tick < settle_ticks + press_ticks; ++tick) {
        loop.step(tick < settle_ticks ? home : target_m, wrench_gain);
        const double force_N = loop.state.wrench_N.dot(into_wall);
        const bool touching = force_N > 0.0;
        ticks_touching += touching || ticks_touching > 0 ? 1 : 0;
        press.peak_N = std::max(press.peak_N, force_N);
        press.breaks += touched_before && !touching ? 1 : 0;
        press.late_breaks += touched_before && !touching && ticks_touching > 300 ? 1 : 0;
        touched_before = touching;
        if (tick >= settle_ticks + press_ticks - rest_ticks) {
            press.rest_N += force_N / rest_ticks;
            press.rest_depth_m += (loop.state.hand_m - wall.point_m).dot(into_wall) / rest_ticks;
        }
    }
    return press;
}
