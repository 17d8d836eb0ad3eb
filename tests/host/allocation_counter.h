/**
 * Counts heap allocations made by the code under test (operator new, and malloc as Eigen uses it).
 */
#pragma once

namespace test {

long allocations();

} // namespace test
