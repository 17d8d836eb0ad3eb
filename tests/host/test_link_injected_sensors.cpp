#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "link/injected_sensors.h"
#include "node_bench.h"

using namespace hpmc;
using test::frame;

namespace {

PeriodFrames one(const can_frame_t &f) {
    PeriodFrames frames{};
    frames.append(&f, 1);
    return frames;
}

const PeriodFrames kNothing{};

} // namespace

TEST_CASE("RPDO4: position, low byte of the period, no flags, temperature") {
    const InjectedSensors sensors(65536);
    PeriodFrames frames{};
    // A quarter turn is 4000h; a negative angle in two's complement.
    sensors.inject({M_PI / 2, -2.0 * M_PI / 65536.0, 0.0}, 0x1FE, frames);
    REQUIRE(frames.count == 3);
    const std::vector<std::vector<unsigned>> expected{
        {0x00, 0x40, 0x00, 0x00, 0xFE, 0x00, 0xFA, 0x00},
        {0xFF, 0xFF, 0xFF, 0xFF, 0xFE, 0x00, 0xFA, 0x00},
        {0x00, 0x00, 0x00, 0x00, 0xFE, 0x00, 0xFA, 0x00}};
    for (unsigned i = 0; i < 3; ++i) {
        const can_frame_t &f = frames.frames[i];
        CHECK(f.id == 0x501 + i);
        CHECK(f.len == 8);
        CHECK(std::vector<unsigned>(f.data, f.data + 8) == expected[i]);
    }
}

TEST_CASE("the plant's torque is 6077h of TPDO1, held for two periods, then none") {
    InjectedSensors sensors(65536);
    CHECK(sensors.torque_Nm(kNothing) == Eigen::Vector3d::Zero());
    const can_frame_t tpdo1 = frame(0x182, {0, 0, 0, 0, 0x18, 0xFC, 0x37, 0x06}); // -1000 mN m
    CHECK(sensors.torque_Nm(one(tpdo1)) == Eigen::Vector3d(0.0, -1.0, 0.0));
    CHECK(sensors.torque_Nm(kNothing) == Eigen::Vector3d(0.0, -1.0, 0.0));
    CHECK(sensors.torque_Nm(kNothing) == Eigen::Vector3d(0.0, -1.0, 0.0));
    CHECK(sensors.torque_Nm(kNothing) == Eigen::Vector3d::Zero());
    CHECK(sensors.torque_Nm(one(tpdo1)) == Eigen::Vector3d(0.0, -1.0, 0.0));
    sensors.reset();
    CHECK(sensors.torque_Nm(kNothing) == Eigen::Vector3d::Zero());
}

TEST_CASE("only whole TPDO1 of the three nodes count") {
    InjectedSensors sensors(65536);
    for (const can_frame_t &f :
         {frame(0x181, {0, 0, 0, 0, 0xE8, 0x03, 0x37}), frame(0x180, {0, 0, 0, 0, 1, 1, 0, 0}),
          frame(0x184, {0, 0, 0, 0, 1, 1, 0, 0}), frame(0x281, {0, 0, 0, 0, 1, 1, 0, 0}),
          frame(0x081, {0, 0, 0, 0, 1, 1, 0, 0})}) {
        CHECK(sensors.torque_Nm(one(f)) == Eigen::Vector3d::Zero());
    }
}
