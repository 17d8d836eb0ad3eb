/**
 * The four host layers of Harmonic Passive Motor Control as one step per SYNC period:
 * elastic band -> dynamic task -> region of attraction -> joint coordination (paper, fig. 2).
 *
 * Links are ordered elbow, wrist, hand. SI units, shoulder at the origin, planar, no gravity.
 */
#pragma once

#include <Eigen/Core>
#include <array>

#include "hpmc/dynamic_task.h"
#include "hpmc/elastic_band.h"
#include "hpmc/joint_coordination.h"
#include "hpmc/planar_arm.h"
#include "hpmc/region_of_attraction.h"

namespace hpmc {

struct HpmcConfig {
    PlanarArmConfig arm;
    ElasticBandConfig elastic_band;
    DynamicTaskConfig dynamic_task;
    RegionOfAttractionConfig region_of_attraction;
    JointCoordinationConfig joint_coordination;
};

struct HpmcInput {
    Eigen::Vector2d x_t_m;    ///< target of the hand
    Eigen::Vector3d q_rad;    ///< joint angles as the nodes measured them
    Eigen::Vector2d wrench_N; ///< force of the hand on its environment, as measured
};

/// All zero until a step fills it in.
struct HpmcOutput {
    using PerLink = std::array<Eigen::Vector2d, 3>;
    static PerLink zero_per_link() {
        return {Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
    }

    Eigen::Vector2d x_d_m = Eigen::Vector2d::Zero();      ///< elastic band
    Eigen::Vector2d v_d_m_s = Eigen::Vector2d::Zero();    ///< elastic band
    double phi_rad = 0.0;                                 ///< dynamic task: hand orientation
    Eigen::Vector3d q_d_rad = Eigen::Vector3d::Zero();    ///< dynamic task
    bool saturated = false;                               ///< x_d out of reach, put on the ring
    PerLink x_link_d_m = zero_per_link();                 ///< positions of the links' ends at q_d
    PerLink x_link_m = zero_per_link();                   ///< positions of the links' ends at q
    PerLink w_link_N = zero_per_link();                   ///< region of attraction
    Eigen::Vector2d wrench_N = Eigen::Vector2d::Zero();   ///< wrench after the low-pass
    Eigen::Vector3d tau_d_Nm = Eigen::Vector3d::Zero();   ///< joint coordination
    Eigen::Vector3d tau_max_Nm = Eigen::Vector3d::Zero(); ///< joint coordination, 0..TA
};

class HpmcController {
  public:
    explicit HpmcController(const HpmcConfig &config);

    /// Puts the elastic band at rest at `x_m`, the posture at `q_rad`, and empties the filters.
    void reset(const Eigen::Vector2d &x_m, const Eigen::Vector3d &q_rad);

    /// One SYNC period. Finite input gives finite output; NaN in gives NaN out (the caller checks).
    HpmcOutput step(const HpmcInput &input);

    /// Direction of the expected interaction W_t by message: dynamic_task.direction fixed from then
    /// on.
    void set_task_direction(double w_t_rad) { dynamic_task_.set_direction(w_t_rad); }

  private:
    PlanarArm arm_;
    ElasticBand elastic_band_;
    DynamicTask dynamic_task_;
    RegionOfAttraction region_of_attraction_;
    JointCoordination joint_coordination_;
};

} // namespace hpmc
