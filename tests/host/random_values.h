/**
 * Repeatable random numbers, the same on every standard library.
 */
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>

namespace test {

class Random {
  public:
    explicit Random(std::uint64_t seed) : engine_(seed) {}

    double uniform(double low, double high) {
        return low + (high - low) * std::ldexp(static_cast<double>(engine_() >> 11U), -53);
    }

    Eigen::Vector3d vector3(double low, double high) {
        const double a = uniform(low, high);
        const double b = uniform(low, high);
        const double c = uniform(low, high);
        return {a, b, c};
    }

    /// A point of the plane at a distance from the origin in low..high.
    Eigen::Vector2d on_ring(double low, double high) {
        const double distance = uniform(low, high);
        const double bearing = uniform(-M_PI, M_PI);
        return distance * Eigen::Vector2d(std::cos(bearing), std::sin(bearing));
    }

  private:
    std::mt19937_64 engine_;
};

} // namespace test
