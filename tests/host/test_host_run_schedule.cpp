#include <doctest/doctest.h>

#include <cmath>
#include <set>

#include "host/run_schedule.h"
#include "hpmc/planar_arm.h"
#include "node_bench.h"

using namespace hpmc;

namespace {

constexpr double kIncrement_rad = 2.0 * M_PI / 65536.0;

} // namespace

TEST_CASE("a repetition: setup, 16 reaches of a second, stop") {
    const RunSchedule schedule(test::clock_config());
    CHECK(schedule.periods_per_repetition() == 1000 + 16 * 1000 + 250);
    int changes = 0;
    for (std::int64_t period = 0; period < 17250; ++period) {
        const SchedulePoint point = schedule.at(period);
        const bool reaching = period >= 1000 && period < 17000;
        const int reach = reaching ? static_cast<int>(period - 1000) / 1000 : -1;
        CHECK(point.repetition == 0);
        CHECK(point.period == period);
        CHECK(point.reach == reach);
        CHECK(point.target == (reaching ? reach / 2 + 1 : 0));
        CHECK(point.stopping == (period >= 17000));
        CHECK(point.target_changes == (reaching && period % 1000 == 0));
        CHECK(point.x_t_m == schedule.target_m(reaching && reach % 2 == 0 ? point.target : 0));
        changes += point.target_changes ? 1 : 0;
    }
    CHECK(changes == 16);
}

TEST_CASE("repetitions follow one another without a gap") {
    const RunSchedule schedule(test::clock_config({"experiment.repetitions=3"}));
    const SchedulePoint last = schedule.at(2 * 17250 - 1);
    const SchedulePoint first = schedule.at(2 * 17250);
    CHECK(last.repetition == 1);
    CHECK(last.stopping);
    CHECK(first.repetition == 2);
    CHECK(first.period == 0);
    CHECK(first.reach == -1);
    CHECK_FALSE(first.stopping);
}

TEST_CASE("targets stand on the clock, counter-clockwise from +x") {
    const RunSchedule schedule(
        test::clock_config({"experiment.centre_m=[0.28, 0.05]", "experiment.radius_m=0.08"}));
    const Eigen::Vector2d centre_m(0.28, 0.05);
    CHECK(schedule.target_m(0) == centre_m);
    CHECK((schedule.target_m(1) - centre_m - Eigen::Vector2d(0.08, 0.0)).norm() < 1e-15);
    CHECK((schedule.target_m(3) - centre_m - Eigen::Vector2d(0.0, 0.08)).norm() < 1e-15);
    CHECK((schedule.target_m(5) - centre_m - Eigen::Vector2d(-0.08, 0.0)).norm() < 1e-15);
    for (int target = 1; target <= kClockTargets; ++target) {
        CHECK((schedule.target_m(target) - centre_m).norm() ==
              doctest::Approx(0.08).epsilon(1e-12));
    }
}

TEST_CASE("periods of other lengths") {
    const RunSchedule schedule(test::clock_config(
        {"experiment.period_s=0.2", "schedule.setup_s=1.5", "schedule.stop_s=0.3"}));
    CHECK(schedule.periods_per_repetition() == 1500 + 16 * 200 + 300);
    CHECK(schedule.at(1699).reach == 0);
    CHECK(schedule.at(1700).reach == 1);
}

TEST_CASE("fewer reaches end where the clock would go on") {
    const RunSchedule schedule(
        test::clock_config({"experiment.reaches=3", "experiment.repetitions=2"}));
    CHECK(schedule.periods_per_repetition() == 1000 + 3 * 1000 + 250);
    CHECK(schedule.at(3999).reach == 2);
    CHECK(schedule.at(3999).target == 2);
    CHECK(schedule.at(4000).stopping);
    CHECK(schedule.at(4250).repetition == 1);
    CHECK(schedule.at(4250 + 1000).reach == 0);
}

TEST_CASE("targets are numbered without a gap, through repetitions and on every path") {
    for (const std::vector<std::string> &overrides :
         {std::vector<std::string>{},
          {"experiment.path=figure_of_eight", "experiment.reaches=2"},
          {"experiment.path=figure_of_eight", "experiment.waypoint_s=0.03",
           "experiment.reaches=3"}}) {
        CAPTURE(overrides.size());
        std::vector<std::string> all{"experiment.period_s=0.5", "experiment.repetitions=2"};
        all.insert(all.end(), overrides.begin(), overrides.end());
        const RunSchedule schedule(test::clock_config(all));
        std::int64_t next = 0;
        for (std::int64_t period = 0; period < 2 * schedule.periods_per_repetition(); ++period) {
            const SchedulePoint point = schedule.at(period);
            if (point.target_changes) {
                REQUIRE(point.target_seq == next++);
            } else if (point.reach >= 0) {
                REQUIRE(point.x_t_m == schedule.at(period - 1).x_t_m);
            }
            REQUIRE((!point.reach_begins || point.target_changes));
        }
        CHECK(next > 0);
    }
}

TEST_CASE("the eight: through home, as high as the radius says, half as wide, by waypoints") {
    const RunSchedule schedule(test::clock_config(
        {"experiment.path=figure_of_eight", "experiment.period_s=4", "experiment.reaches=2",
         "experiment.waypoint_s=0.02", "experiment.radius_m=0.08"}));
    CHECK(schedule.periods_per_repetition() == 1000 + 2 * 4000 + 250);
    const Eigen::Vector2d home_m(0.3, 0.0);
    Eigen::Vector2d low = home_m;
    Eigen::Vector2d high = home_m;
    int changes = 0;
    for (std::int64_t period = 1000; period < 9000; ++period) {
        const SchedulePoint point = schedule.at(period);
        low = low.cwiseMin(point.x_t_m);
        high = high.cwiseMax(point.x_t_m);
        changes += point.target_changes ? 1 : 0;
        REQUIRE(point.target == 0);
        REQUIRE(point.reach == (period - 1000) / 4000);
        // No jump: the eight is at most (0.08, 0.08) m times the angle of a waypoint long.
        REQUIRE((point.x_t_m - schedule.at(period - 1).x_t_m).norm() <
                0.08 * M_SQRT2 * 2.0 * M_PI * 20.0 / 4000.0);
    }
    CHECK(changes == 2 * 200);
    CHECK((low - home_m - Eigen::Vector2d(-0.04, -0.08)).norm() < 1e-4);
    CHECK((high - home_m - Eigen::Vector2d(0.04, 0.08)).norm() < 1e-4);
    CHECK(schedule.at(1000).x_t_m == home_m);
    CHECK((schedule.at(3000).x_t_m - home_m).norm() < 1e-12);
    CHECK(schedule.at(9000).x_t_m == home_m);
}

TEST_CASE("start poses: home with the paper's posture, each joint off by at most one increment") {
    const RunConfig config = test::clock_config();
    const PlanarArm arm(config.hpmc.arm);
    const Eigen::Vector3d home_rad =
        arm.inverse(config.experiment.centre_m, config.hpmc.dynamic_task.w_t_rad).q_rad;
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1.0);
    Eigen::Vector3d high = -low;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    constexpr int kPoses = 400;
    for (int repetition = 0; repetition < kPoses; ++repetition) {
        const Eigen::Vector3d offset =
            (start_pose_rad(config, repetition) - home_rad) / kIncrement_rad;
        low = low.cwiseMin(offset);
        high = high.cwiseMax(offset);
        mean += offset / kPoses;
    }
    // Uniform: its ends are approached, its mean is near zero (standard error 0.029).
    for (int joint = 0; joint < 3; ++joint) {
        CAPTURE(joint);
        CHECK(low[joint] >= -1.0 - 1e-6);
        CHECK(low[joint] < -0.97);
        CHECK(high[joint] <= 1.0 + 1e-6);
        CHECK(high[joint] > 0.97);
        CHECK(std::abs(mean[joint]) < 0.12);
    }
}

TEST_CASE("start poses depend on seed and repetition alone") {
    const RunConfig one = test::clock_config({"experiment.seed=1"});
    const RunConfig again = test::clock_config({"experiment.seed=1", "experiment.repetitions=9"});
    const RunConfig two = test::clock_config({"experiment.seed=2"});
    std::set<double> angles;
    for (int repetition = 0; repetition < 20; ++repetition) {
        CHECK(start_pose_rad(one, repetition) == start_pose_rad(again, repetition));
        for (const RunConfig &config : {one, two}) {
            for (const double angle_rad : start_pose_rad(config, repetition)) {
                angles.insert(angle_rad);
            }
        }
    }
    CHECK(angles.size() == 20 * 2 * 3);
}
