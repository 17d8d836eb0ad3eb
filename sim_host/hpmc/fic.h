/**
 * Scalar fractal impedance controller (FIC) in double precision: profile force in divergence,
 * spring about the mid point of the latched excursion in convergence (paper, eq. 1).
 *
 * The force profile F stays with the caller, who passes F(|e|) in: only its value at the present
 * error and at the latched excursion is ever needed. Units are the caller's; the force has the sign
 * of the error.
 */
#pragma once

namespace hpmc {

enum class PhaseRule {
    body_motion, ///< divergence while the body does not move toward the desired point
    error_growth ///< divergence while |e| grows
};

struct FicConfig {
    PhaseRule phase_rule = PhaseRule::body_motion;
    double delta = 0.0;          ///< motion that counts as such: half a sensor step, 0 if exact
    double stall_time_s = 0.020; ///< without motion for longer, the body counts as resting
    double period_s = 0.001;
};

class Fic {
  public:
    explicit Fic(const FicConfig &config);

    /// As after enabling: no direction of motion, nothing latched.
    void reset(double position);

    /// error = desired - position; profile_force = F(|error|), not negative.
    double step(double error, double position, double profile_force);

    bool converging() const { return converging_; }

  private:
    bool body_approaches(double error, double position);
    bool error_shrinks(double excursion, bool crossed_zero);
    void latch(double excursion, double profile_force);

    FicConfig config_;
    long stall_ticks_;
    int side_ = 0;      ///< sign of the error, 0 before the first step
    int direction_ = 0; ///< of the body's motion
    double turning_position_ = 0.0;
    long rest_ticks_ = 0; ///< since the body last moved, that tick included
    double turning_excursion_ = 0.0;
    double excursion_max_ = 0.0;
    double force_max_ = 0.0;
    bool converging_ = false;
};

} // namespace hpmc
