# Language levels, optimisation and warnings: the same for every target of the project.

set(CMAKE_C_STANDARD 11)
set(CMAKE_CXX_STANDARD 20) # designated initialisers in firmware headers
foreach(language C CXX)
    set(CMAKE_${language}_STANDARD_REQUIRED ON)
    set(CMAKE_${language}_EXTENSIONS OFF)
    set(CMAKE_${language}_FLAGS_RELEASE "-O2 -DNDEBUG")
endforeach()
if(NOT CMAKE_BUILD_TYPE)
    set(CMAKE_BUILD_TYPE Release)
endif()

# No fused multiply-add: firmware on host and Cortex-M4, and `sil` and `vcan`, agree bit for bit.
add_compile_options(-ffp-contract=off -fdiagnostics-color=always)

# An image is the same byte for byte in whichever folder it is built.
if(CMAKE_SYSTEM_NAME STREQUAL "Generic")
    add_compile_options(-ffile-prefix-map=${CMAKE_SOURCE_DIR}=. -ffile-prefix-map=${CMAKE_BINARY_DIR}=build)
endif()

# Flash is scarce: small, but for the control law (firmware/CMakeLists.txt), whose time counts.
if(CMAKE_SYSTEM_NAME STREQUAL "Generic")
    set(CMAKE_C_FLAGS_RELEASE "-Os -DNDEBUG")
endif()

# Third-party and generated sources opt out with target_compile_options(... PRIVATE -w).
add_compile_options(-Wall -Wextra -Werror -Wconversion -Wshadow -pedantic)
add_compile_options(
    "$<$<COMPILE_LANGUAGE:C>:-Wsign-conversion;-Wdouble-promotion;-Wswitch-enum>")

# For all: the firmware's structs hold these numbers, and the simulator links the firmware.
if(HPMC_FIXED)
    add_compile_definitions(CONTROL_FIXED_POINT)
endif()

if(HPMC_SANITIZE)
    add_compile_options(-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all
                        -fno-omit-frame-pointer -g)
    add_link_options(-fsanitize=address,undefined)
endif()
if(HPMC_COVERAGE)
    add_compile_options(--coverage -O0 -g)
    add_link_options(--coverage)
endif()
