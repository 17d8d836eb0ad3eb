# Debian's libraries for the host side: Eigen3::Eigen, CLI11::CLI11,
# tomlplusplus::tomlplusplus, PkgConfig::ode, Threads::Threads, and doctest::doctest for its tests.

find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(CLI11 REQUIRED)
find_package(tomlplusplus REQUIRED)
pkg_check_modules(ode REQUIRED IMPORTED_TARGET ode)
if(BUILD_TESTING)
    find_package(doctest REQUIRED)
endif()
