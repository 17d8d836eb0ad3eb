#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "hpmc/fic.h"
#include "random_values.h"

using namespace hpmc;

namespace {

/// Two plateaus, as a joint's profile: the case that needs min(C, F) to be passive.
double two_plateaus(double a) {
    constexpr double t_1 = 1.0;
    constexpr double t_2 = 4.0;
    if (a <= 7.5) {
        return t_1 * a / 7.5;
    }
    if (a <= 9.0) {
        return t_1;
    }
    return a < 16.0 ? t_1 + (t_2 - t_1) * (a - 9.0) / 7.0 : t_2;
}

double linear(double a) {
    return 2.0 * a;
}

FicConfig exact(PhaseRule rule) {
    FicConfig config;
    config.phase_rule = rule;
    return config;
}

const PhaseRule both_rules[] = {PhaseRule::body_motion, PhaseRule::error_growth};

} // namespace

TEST_CASE("divergence follows the profile, convergence the spring about the mid point") {
    for (const PhaseRule rule : both_rules) {
        Fic fic{exact(rule)};
        fic.reset(0.0);
        for (const double q : {1.0, 2.0, 3.0, 4.0}) {
            CHECK(fic.step(-q, q, linear(q)) == doctest::Approx(-linear(q)));
            CHECK_FALSE(fic.converging());
        }
        for (const double q : {3.0, 2.0, 1.0, 0.5}) {
            CHECK(fic.step(-q, q, linear(q)) == doctest::Approx(-2.0 * 8.0 / 4.0 * (q - 2.0)));
            CHECK(fic.converging());
        }
    }
}

TEST_CASE("the zero crossing latches anew on the other side") {
    for (const PhaseRule rule : both_rules) {
        Fic fic{exact(rule)};
        fic.reset(0.0);
        for (const double q : {1.0, 4.0, 2.0, 0.5}) {
            fic.step(-q, q, linear(q));
        }
        CHECK(fic.step(0.5, -0.5, linear(0.5)) == doctest::Approx(1.0));
        CHECK(fic.step(2.0, -2.0, linear(2.0)) == doctest::Approx(4.0));
        CHECK(fic.step(1.5, -1.5, linear(1.5)) == doctest::Approx(2.0 * 4.0 / 2.0 * 0.5));
    }
}

TEST_CASE("a desired point that jumps across the body latches anew, in divergence too") {
    for (const PhaseRule rule : both_rules) {
        Fic fic{exact(rule)};
        fic.reset(0.0);
        fic.step(-4.0, 4.0, linear(4.0));
        // The desired point jumps from 0 to 6 while the body turns back up.
        fic.step(2.0, 4.0, linear(2.0));
        CHECK(fic.step(1.5, 4.5, linear(1.5)) == doctest::Approx(2.0 * 4.0 / 2.0 * 0.5));
    }
}

TEST_CASE("the force at the turning point stays latched when the profile changes") {
    for (const PhaseRule rule : both_rules) {
        Fic fic{exact(rule)};
        fic.reset(0.0);
        fic.step(-4.0, 4.0, 8.0);
        CHECK(fic.step(-3.0, 3.0, 100.0) == doctest::Approx(-2.0 * 8.0 / 4.0 * 1.0));
    }
}

TEST_CASE("convergence never exceeds the profile: min(C, F)") {
    for (const PhaseRule rule : both_rules) {
        Fic fic{exact(rule)};
        fic.reset(0.0);
        fic.step(-16.0, 16.0, two_plateaus(16.0));
        // C(15.5) = 3.75, F(15.5) = 3.786; C(13) = 2.5, F(13) = 2.714; C(12) = 2, F(12) = 2.286.
        CHECK(fic.step(-15.5, 15.5, two_plateaus(15.5)) == doctest::Approx(-3.75));
        CHECK(fic.step(-13.0, 13.0, 2.0) == doctest::Approx(-2.0));
    }
}

TEST_CASE("motion less than delta turns nothing; a body that rests longer diverges") {
    FicConfig config;
    config.delta = 0.5;
    config.stall_time_s = 0.020;
    Fic fic{config};
    fic.reset(0.0);
    fic.step(-10.0, 10.0, 20.0);
    fic.step(-10.0 + 0.5, 9.5, 19.0);
    CHECK_FALSE(fic.converging());
    fic.step(-10.0 + 0.6, 9.4, 18.8);
    CHECK(fic.converging());
    for (int tick = 2; tick <= 20; ++tick) {
        fic.step(-9.4, 9.4, 18.8);
        REQUIRE(fic.converging());
    }
    fic.step(-9.4, 9.4, 18.8);
    CHECK_FALSE(fic.converging());
}

TEST_CASE("body_motion: a desired point that runs away does not end the convergence") {
    Fic body{exact(PhaseRule::body_motion)};
    Fic growth{exact(PhaseRule::error_growth)};
    for (Fic *fic : {&body, &growth}) {
        fic->reset(0.0);
        fic->step(1.0, 0.0, 2.0);
        fic->step(0.9, 0.1, 1.8); // approaches
        fic->step(1.5, 0.2, 3.0); // still approaches, but the desired point moved further
    }
    CHECK(body.converging());
    CHECK_FALSE(growth.converging());
}

TEST_CASE("first motion in either direction counts") {
    for (const double sign : {-1.0, 1.0}) {
        Fic fic{exact(PhaseRule::body_motion)};
        fic.reset(0.0);
        fic.step(sign * 4.0, 0.0, 8.0);
        CHECK_FALSE(fic.converging());
        fic.step(sign * 3.0, sign * 1.0, 6.0);
        CHECK(fic.converging());
    }
}

TEST_CASE("with a fixed target no closed cycle of q gains energy") {
    test::Random random(10);
    for (const PhaseRule rule : both_rules) {
        for (int run = 0; run < 400; ++run) {
            Fic fic{exact(rule)};
            fic.reset(0.0);
            // A closed path of straight strokes, walked twice; the work is summed over the second.
            double corner[6];
            for (double &q : corner) {
                q = random.uniform(-20.0, 20.0);
            }
            constexpr int steps = 2000;
            double work = 0.0;
            double position = 0.0;
            for (int lap = 0; lap < 2; ++lap) {
                work = 0.0;
                for (const double end : corner) {
                    const double start = position;
                    for (int i = 1; i <= steps; ++i) {
                        const double next = start + (end - start) * i / steps;
                        const double force = fic.step(-next, next, two_plateaus(std::abs(next)));
                        work += force * (next - position);
                        position = next;
                    }
                }
            }
            // Rectangle rule: off by a step of the path times the force, at most, per stroke.
            REQUIRE(work < 6.0 * 4.0 * 40.0 / steps);
        }
    }
}
