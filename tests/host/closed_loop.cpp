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

} // namespace

test::ClosedLoopRun test::run_clock(PhaseRule phase_rule, const Eigen::Vector3d &offset_inc) {
    const Eigen::Vector2d home(0.3, 0.0);
    const PlanarArm arm{PlanarArmConfig{}};
    const Eigen::Vector3d start =
        on_grid(arm.inverse(home, 155.0 * M_PI / 180.0).q_rad, increment_rad) +
        increment_rad * offset_inc;
    ArmPlant plant{ArmPlantConfig{}};
    plant.reset(start);

    FicConfig fic_config;
    fic_config.phase_rule = phase_rule;
    fic_config.delta = increment_rad / 2.0;
    std::array<Fic, 3> fic{Fic{fic_config}, Fic{fic_config}, Fic{fic_config}};
    for (std::size_t i = 0; i < 3; ++i) {
        fic[i].reset(start[static_cast<Eigen::Index>(i)]);
    }
    HpmcController host{HpmcConfig{}};
    host.reset(arm.link_ends(start)[hand], start);

    ClosedLoopRun run;
    run.q_start_rad = start;
    Eigen::Vector3d q_before = start;
    const Eigen::Vector3d limit_Nm(30.0, 20.0, 5.0);
    ReachMeter meter;
    for (int tick = 0; tick < settle_ticks + 16 * reach_ticks; ++tick) {
        const int reach = tick < settle_ticks ? -1 : (tick - settle_ticks) / reach_ticks;
        Eigen::Vector2d target = home;
        if (reach >= 0 && reach % 2 == 0) {
            const double angle = reach / 2 * M_PI / 4.0;
            target += 0.1 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        }
        const ArmPlantState state = plant.state();
        const Eigen::Vector3d q = on_grid(state.q_rad, increment_rad);
        const HpmcOutput command = host.step({target, q_before, Eigen::Vector2d::Zero()});
        q_before = q;

        const Eigen::Vector3d error = on_grid(command.q_d_rad, increment_rad) - q;
        const Eigen::Vector3d tau_d = on_grid(command.tau_d_Nm, 1e-3);
        const Eigen::Vector3d tau_max = on_grid(command.tau_max_Nm, 1e-3);
        Eigen::Vector3d tau;
        for (std::size_t i = 0; i < 3; ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            const double profile =
                torque_profile_Nm(std::abs(error[row]), tau_d[row], tau_max[row]);
            tau[row] = fic[i].step(error[row], q[row], profile);
        }
        tau = on_grid(tau.cwiseMin(limit_Nm).cwiseMax(-limit_Nm), 1e-3);
        run.torques_Nm.push_back(tau);

        if (reach >= 0) {
            meter.add(command, state);
            if (tick % reach_ticks == reach_ticks - 1) {
                run.reaches.push_back(meter.figures());
                meter = ReachMeter{};
            }
        }
        plant.advance(tau, 1e-3);
    }
    return run;
}
