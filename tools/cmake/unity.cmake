# UNITY_ROOT must hold Unity's sources. `./rig test` puts Debian's copy there; who builds without it
# gets the upstream release.

if(NOT EXISTS ${UNITY_ROOT}/src/unity.c)
    include(FetchContent)
    FetchContent_Declare(unity GIT_REPOSITORY https://github.com/ThrowTheSwitch/Unity.git
                         GIT_TAG v2.5.1 GIT_SHALLOW ON)
    FetchContent_GetProperties(unity)
    if(NOT unity_POPULATED)
        FetchContent_Populate(unity)
    endif()
    set(UNITY_ROOT ${unity_SOURCE_DIR})
endif()
