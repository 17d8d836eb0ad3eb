/**
 * The arm in ODE: three slender rods on hinges in a plane, torque-driven, no gravity.
 *
 * Stands in for the physical arm; owns nothing of the control. Settings that make it second-order
 * accurate: ERP 1, CFM 0, finite rotation mode, mean of old and new torque in the first step after
 * a change of torque; dWorldStep, since QuickStep draws random numbers.
 *
 * An optional wall stands in the way of the hand's end: a plane that pushes along its normal with
 * stiffness and damping, never pulls, and has no friction. It is ODE's contact joint with the ERP
 * and CFM that make it that spring and damper, integrated implicitly (ODE manual, "How to use ERP
 * and CFM"): at a step h its damping is c + h k, e.g. 20 N s/m more at 1e5 N/m and 0.2 ms.
 */
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <memory>

namespace hpmc {

struct WallConfig {
    enum class Surface { none, plane };
    Surface surface = Surface::none;
    bool present() const { return surface != Surface::none; }
    Eigen::Vector2d point_m{0.35, 0.0};
    double normal_rad = M_PI;     ///< from +x, out of the wall, to the side where the hand may be
    double stiffness_N_m = 1e4;   ///< 1e3..1e5
    double damping_N_s_m = 100.0; ///< 0..1000
};

struct ArmPlantConfig {
    Eigen::Vector3d length_m{0.282, 0.269, 0.044};
    Eigen::Vector3d mass_kg{4.0, 2.5, 1.0};
    double joint_friction_Nm_s_rad = 0.02;
    double step_s = 0.0002; ///< of ODE, 0.00005..0.001; must divide the joint period
    WallConfig wall;
};

struct ArmPlantState {
    Eigen::Vector3d q_rad;
    Eigen::Vector3d qd_rad_s;
    Eigen::Vector2d hand_m;
    Eigen::Vector2d hand_m_s;
    Eigen::Vector2d wrench_N; ///< force of the hand on its environment, of the last step of ODE
};

class ArmPlant {
  public:
    /// Throws std::invalid_argument when a parameter is out of range.
    explicit ArmPlant(const ArmPlantConfig &config);
    ~ArmPlant();
    ArmPlant(const ArmPlant &) = delete;
    ArmPlant &operator=(const ArmPlant &) = delete;

    /// Sets the pose, at rest, and forgets the torque and the external force held before: from here
    /// on the plant runs bit for bit like a fresh one.
    void reset(const Eigen::Vector3d &q_rad);

    /// Force of the environment on the hand, held until changed.
    void set_external_force(const Eigen::Vector2d &force_N);

    /// Holds tau_Nm for duration_s, a multiple of step_s (rounded to one).
    void advance(const Eigen::Vector3d &tau_Nm, double duration_s);

    ArmPlantState state() const;

    /// Only ODE's own steps, nothing around them: what a benchmark compares the rest with.
    void advance_ode_alone(long steps);

  private:
    struct World;
    std::unique_ptr<World> world_;
};

} // namespace hpmc
