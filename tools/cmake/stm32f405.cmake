# Toolchain file for the Cortex-M4 of the STM32F405: Debian's gcc-arm-none-eabi.
# HPMC_FIXED (the preset sets it) leaves the floating-point unit unused: no float code at all.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY) # without a linker script nothing links
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES HPMC_FIXED)
find_program(CMAKE_C_COMPILER arm-none-eabi-gcc REQUIRED)
find_program(CMAKE_OBJCOPY arm-none-eabi-objcopy REQUIRED)

set(_core "-mcpu=cortex-m4 -mthumb")
if(HPMC_FIXED)
    string(APPEND _core " -mfloat-abi=soft")
else()
    string(APPEND _core " -mfpu=fpv4-sp-d16 -mfloat-abi=hard")
endif()
set(CMAKE_C_FLAGS_INIT "${_core} -ffunction-sections -fdata-sections -fno-common -fstack-usage")
set(CMAKE_EXE_LINKER_FLAGS_INIT "${_core}")
