/**
 * The arm's Lagrangian equations integrated by Runge-Kutta of fourth order: the exact motion that
 * the plant in ODE is measured against. Independent of ODE and of the plant's sources.
 *
 * In the links' angles from +x, theta: sum_j c_ij (cos(theta_i - theta_j) theta_j'' +
 * sin(theta_i - theta_j) theta_j'^2) = Q_i, slender rods, viscous friction in the joints.
 */
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

#include "plant/arm_plant.h"

namespace test {

class ExactArm {
  public:
    explicit ExactArm(const hpmc::ArmPlantConfig &config)
        : length_m_(config.length_m), friction_(config.joint_friction_Nm_s_rad) {
        const Eigen::Vector3d &l = config.length_m;
        const Eigen::Vector3d &m = config.mass_kg;
        for (Eigen::Index i = 0; i < 3; ++i) {
            const double beyond_i = m.tail(2 - i).sum();
            coupling_(i, i) = l[i] * l[i] * (m[i] / 3.0 + beyond_i);
            for (Eigen::Index j = i + 1; j < 3; ++j) {
                const double beyond_j = m.tail(2 - j).sum();
                coupling_(i, j) = l[i] * l[j] * (m[j] / 2.0 + beyond_j);
                coupling_(j, i) = coupling_(i, j);
            }
        }
    }

    void reset(const Eigen::Vector3d &q_rad) {
        theta_ << q_rad[0], q_rad[0] + q_rad[1], q_rad.sum();
        omega_.setZero();
    }

    void advance(const Eigen::Vector3d &tau_Nm, const Eigen::Vector2d &force_N, double duration_s,
                 int substeps) {
        const double h = duration_s / substeps;
        for (int i = 0; i < substeps; ++i) {
            const auto rate = [&](const Eigen::Vector3d &theta, const Eigen::Vector3d &omega) {
                return acceleration(theta, omega, tau_Nm, force_N);
            };
            const Eigen::Vector3d a1 = rate(theta_, omega_);
            const Eigen::Vector3d v2 = omega_ + h / 2.0 * a1;
            const Eigen::Vector3d a2 = rate(theta_ + h / 2.0 * omega_, v2);
            const Eigen::Vector3d v3 = omega_ + h / 2.0 * a2;
            const Eigen::Vector3d a3 = rate(theta_ + h / 2.0 * v2, v3);
            const Eigen::Vector3d v4 = omega_ + h * a3;
            const Eigen::Vector3d a4 = rate(theta_ + h * v3, v4);
            theta_ += h / 6.0 * (omega_ + 2.0 * v2 + 2.0 * v3 + v4);
            omega_ += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        }
    }

    Eigen::Vector3d q_rad() const { return relative(theta_); }
    Eigen::Vector3d qd_rad_s() const { return relative(omega_); }

    /// Kinetic energy for joint angles and rates, in J.
    double energy_J(const Eigen::Vector3d &q_rad, const Eigen::Vector3d &qd_rad_s) const {
        const Eigen::Vector3d theta(q_rad[0], q_rad[0] + q_rad[1], q_rad.sum());
        const Eigen::Vector3d omega(qd_rad_s[0], qd_rad_s[0] + qd_rad_s[1], qd_rad_s.sum());
        return 0.5 * omega.dot(mass_matrix(theta) * omega);
    }

  private:
    static Eigen::Vector3d relative(const Eigen::Vector3d &link) {
        return {link[0], link[1] - link[0], link[2] - link[1]};
    }

    Eigen::Matrix3d mass_matrix(const Eigen::Vector3d &theta) const {
        Eigen::Matrix3d mass;
        for (Eigen::Index i = 0; i < 3; ++i) {
            for (Eigen::Index j = 0; j < 3; ++j) {
                mass(i, j) = coupling_(i, j) * std::cos(theta[i] - theta[j]);
            }
        }
        return mass;
    }

    Eigen::Vector3d acceleration(const Eigen::Vector3d &theta, const Eigen::Vector3d &omega,
                                 const Eigen::Vector3d &tau_Nm,
                                 const Eigen::Vector2d &force_N) const {
        const Eigen::Vector3d joint = tau_Nm - friction_ * relative(omega);
        Eigen::Vector3d load(joint[0] - joint[1], joint[1] - joint[2], joint[2]);
        for (Eigen::Index i = 0; i < 3; ++i) {
            load[i] += length_m_[i] *
                       (std::cos(theta[i]) * force_N.y() - std::sin(theta[i]) * force_N.x());
            for (Eigen::Index j = 0; j < 3; ++j) {
                load[i] -= coupling_(i, j) * std::sin(theta[i] - theta[j]) * omega[j] * omega[j];
            }
        }
        return mass_matrix(theta).inverse() * load;
    }

    Eigen::Vector3d length_m_;
    double friction_;
    Eigen::Matrix3d coupling_;
    Eigen::Vector3d theta_ = Eigen::Vector3d::Zero();
    Eigen::Vector3d omega_ = Eigen::Vector3d::Zero();
};

} // namespace test
