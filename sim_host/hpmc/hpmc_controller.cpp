#include "hpmc/hpmc_controller.h"

namespace hpmc {

HpmcController::HpmcController(const HpmcConfig &config)
    : arm_(config.arm), elastic_band_(config.elastic_band),
      dynamic_task_(config.dynamic_task, config.arm),
      region_of_attraction_(config.region_of_attraction),
      joint_coordination_(config.joint_coordination) {}

void HpmcController::reset(const Eigen::Vector2d &x_m, const Eigen::Vector3d &q_rad) {
    elastic_band_.reset(x_m);
    dynamic_task_.reset(q_rad);
    joint_coordination_.reset();
}

HpmcOutput HpmcController::step(const HpmcInput &input) {
    HpmcOutput output;

    elastic_band_.step(input.x_t_m);
    output.x_d_m = elastic_band_.x_d_m();
    output.v_d_m_s = elastic_band_.v_d_m_s();

    const DesiredPosture posture = dynamic_task_.step(output.x_d_m, output.v_d_m_s, input.q_rad);
    output.phi_rad = posture.phi_rad;
    output.q_d_rad = posture.q_d_rad;
    output.saturated = posture.saturated;

    output.x_link_d_m = arm_.link_ends(output.q_d_rad);
    output.x_link_m = arm_.link_ends(input.q_rad);
    output.w_link_N = region_of_attraction_.step(output.x_link_d_m, output.x_link_m);

    const JointTorques torques =
        joint_coordination_.step(output.w_link_N, output.x_link_m, input.wrench_N);
    output.wrench_N = joint_coordination_.filtered_wrench_N();
    output.tau_d_Nm = torques.tau_d_Nm;
    output.tau_max_Nm = torques.tau_max_Nm;
    return output;
}

} // namespace hpmc
