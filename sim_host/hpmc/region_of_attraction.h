/**
 * Region of attraction: for each link end the wrench that pulls it to its desired position, linear
 * up to the knee, then saturating smoothly (paper, eq. 6, with erratum 4 of docs/theory.md).
 *
 * Links are ordered elbow, wrist, hand. m, N, N/m. The wrench points from actual to desired.
 */
#pragma once

#include <Eigen/Core>
#include <array>

#include "hpmc/planar_arm.h"

namespace hpmc {

struct RegionOfAttractionConfig {
    Eigen::Vector3d stiffness_N_m{11000.0, 25000.0, 14000.0}; ///< K0, above 0
    double saturation_m = 0.020;                              ///< x_b, above 0
    Eigen::Vector3d force_max_N{220.0, 500.0, 280.0};         ///< F_max >= K0 x_b
};

class RegionOfAttraction {
  public:
    /// Throws std::invalid_argument when a parameter is out of range.
    explicit RegionOfAttraction(const RegionOfAttractionConfig &config);

    /// |W| for a distance of the link's end from its desired position.
    double force_N(Link link, double distance_m) const;

    std::array<Eigen::Vector2d, 3> step(const LinkEnds &desired_m, const LinkEnds &actual_m) const;

  private:
    RegionOfAttractionConfig config_;
};

} // namespace hpmc
