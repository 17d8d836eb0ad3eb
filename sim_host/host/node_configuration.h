/**
 * What the host writes into each motor node before it starts it: run configuration -> SDO writes.
 */
#pragma once

#include <array>
#include <vector>

#include "host/run_schedule.h"
#include "link/canopen_master.h"

namespace hpmc {

std::array<std::vector<SdoWrite>, kJoints>
node_configuration(const RunConfig &config, TimeBase time_base = TimeBase::stepped);

} // namespace hpmc
