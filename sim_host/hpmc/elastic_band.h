/**
 * Elastic band: a virtual mass at the desired hand position X_d, pulled to the target X_t by one
 * scalar FIC per axis (paper, eq. 2, with the sign of docs/theory.md, erratum 1).
 *
 * The axes are frozen at each change of target: along the way to it, and normal to that. From rest
 * at a distance D the movement is a half cosine of duration pi sqrt(D / (2 A)) that ends at rest.
 * SI units; forces per unit mass. Integration: semi-implicit Euler, one SYNC period a step.
 */
#pragma once

#include <Eigen/Core>

#include "hpmc/fic.h"

namespace hpmc {

struct ElasticBandConfig {
    double acceleration_max_m_s2 = 0.5223; ///< A, above 0
    double saturation_m = 0.005;           ///< x_b, above 0: distance at which A is reached
    PhaseRule phase_rule = PhaseRule::body_motion;
    double period_s = 0.001; ///< SYNC period, above 0
};

class ElasticBand {
  public:
    /// Throws std::invalid_argument when a parameter is out of range.
    explicit ElasticBand(const ElasticBandConfig &config);

    /// Puts the virtual mass at rest at x_m, which also becomes the target.
    void reset(const Eigen::Vector2d &x_m);

    /// One SYNC period toward x_t_m.
    void step(const Eigen::Vector2d &x_t_m);

    const Eigen::Vector2d &x_d_m() const { return x_d_m_; }
    const Eigen::Vector2d &v_d_m_s() const { return v_d_m_s_; }

  private:
    void freeze_frame(const Eigen::Vector2d &x_t_m);
    double pull_m_s2(Fic &fic, double error_m) const;

    ElasticBandConfig config_;
    Eigen::Vector2d x_d_m_ = Eigen::Vector2d::Zero();
    Eigen::Vector2d v_d_m_s_ = Eigen::Vector2d::Zero();
    Eigen::Vector2d x_t_m_ = Eigen::Vector2d::Zero();
    Eigen::Vector2d along_ = Eigen::Vector2d::UnitX();
    Eigen::Vector2d normal_ = Eigen::Vector2d::UnitY();
    Fic fic_along_;
    Fic fic_normal_;
};

} // namespace hpmc
