# LCM from the Python wheel: target `lcm`, lcm-gen and lcm_wrap_types.

file(GLOB _lcm_prefix LIST_DIRECTORIES true "${HPMC_VENV}/lib/python3*/site-packages")
if(NOT TARGET GLib2::glib)
    # The package's static library asks for it; only the shared one is used here, and it loads GLib.
    add_library(GLib2::glib INTERFACE IMPORTED)
endif()
find_package(lcm CONFIG QUIET PATHS ${_lcm_prefix} NO_DEFAULT_PATH)
if(NOT lcm_FOUND)
    message(FATAL_ERROR "LCM is not in the virtual environment ${HPMC_VENV}: run ./rig build, "
                        "or pass -DHPMC_VENV=<a virtual environment with the package lcm>")
endif()
include(${LCM_USE_FILE})
