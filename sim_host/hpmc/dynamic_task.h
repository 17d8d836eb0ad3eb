/**
 * Dynamic task: the posture that puts the hand on X_d with an orientation chosen for the expected
 * direction of interaction W_t (paper, eqs. 3 to 5, with errata 2 and 3 of docs/theory.md).
 *
 * `paper` aligns the hand with W_t, which makes the wrist torque of an interaction vanish.
 * `optimal` minimises W_t' J J' W_t (unit W_t, m^2) over the hand's orientation. In both, no joint
 * moves more than joint_step_max_rad a step; the hand turns as fast as that allows with its end
 * point kept, and only where even that is impossible the end point is left and each joint clipped
 * by itself. rad, m, shoulder at the origin, elbow on the right of the line to the wrist (q2 >= 0).
 */
#pragma once

#include <Eigen/Core>

#include "hpmc/planar_arm.h"

namespace hpmc {

enum class Posture {
    paper,  ///< closed form: hand along W_t
    optimal ///< minimiser of the paper's general problem
};

enum class TaskDirection {
    fixed,  ///< w_t_rad, or what set_direction gave since
    radial, ///< from the shoulder to X_d
    motion  ///< along the velocity of X_d, kept while it rests
};

struct DynamicTaskConfig {
    Posture posture = Posture::paper;
    TaskDirection direction = TaskDirection::fixed;
    double w_t_rad = 155.0 * M_PI / 180.0; ///< direction of W_t, finite
    double joint_step_max_rad = 0.004;     ///< dQ_m per SYNC period, above 0
};

struct DesiredPosture {
    Eigen::Vector3d q_d_rad; ///< each angle the one nearest to the measured, then bounded in step
    double phi_rad;          ///< hand orientation, sum of q_d
    bool saturated;          ///< X_d was out of reach and was put on the reachable ring
};

class DynamicTask {
  public:
    /// Throws std::invalid_argument when a parameter is out of range.
    DynamicTask(const DynamicTaskConfig &config, const PlanarArmConfig &arm);

    /// The posture at which the joint-step bound begins, as a rule the measured one.
    void reset(const Eigen::Vector3d &q_rad);

    /// Direction of W_t by message; `fixed` from then on.
    void set_direction(double w_t_rad);

    /// One SYNC period. Finite input gives finite output.
    DesiredPosture step(const Eigen::Vector2d &x_d_m, const Eigen::Vector2d &v_d_m_s,
                        const Eigen::Vector3d &q_measured_rad);

    /// W_t' J J' W_t of the hand on x_m with orientation phi_rad and W_t a unit vector, in m^2.
    static double interaction_cost_m2(const PlanarArm &arm, const Eigen::Vector2d &x_m,
                                      double phi_rad, double w_t_rad);

  private:
    struct Candidate {
        Eigen::Vector3d q_rad;
        bool saturated;
        bool within_step;
    };

    void follow_direction(const Eigen::Vector2d &x_d_m, const Eigen::Vector2d &v_d_m_s);
    double optimal_orientation(const Eigen::Vector2d &x_d_m);
    double way_to(double phi_rad, const Eigen::Vector2d &x_d_m) const;
    Candidate candidate(const Eigen::Vector2d &x_d_m, double phi_rad,
                        const Eigen::Vector3d &q_measured_rad) const;

    DynamicTaskConfig config_;
    PlanarArm arm_;
    TaskDirection direction_;
    double w_t_rad_;
    Eigen::Vector3d q_d_rad_ = Eigen::Vector3d::Zero();
    double phi_optimal_rad_ = 0.0; ///< best orientation so far, where the minimiser starts
    unsigned probe_ = 0;           ///< orientation compared with it next
};

} // namespace hpmc
