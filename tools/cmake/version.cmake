# Target hpmc_version: header version.h with HPMC_GIT_HASH, looked up again at every build.
# Runs itself as a script (cmake -P) for that, with SOURCE_DIR and HEADER set.

if(CMAKE_SCRIPT_MODE_FILE)
    cmake_minimum_required(VERSION 3.25)
    find_program(git_program git)
    set(hash "unknown")
    if(git_program)
        execute_process(COMMAND ${git_program} -C ${SOURCE_DIR} status --porcelain
                        RESULT_VARIABLE status OUTPUT_VARIABLE changes ERROR_QUIET)
        if(status EQUAL 0)
            execute_process(COMMAND ${git_program} -C ${SOURCE_DIR} rev-parse --short=12 --verify -q HEAD
                            RESULT_VARIABLE status OUTPUT_VARIABLE hash ERROR_QUIET
                            OUTPUT_STRIP_TRAILING_WHITESPACE)
            if(NOT status EQUAL 0)
                set(hash "uncommitted")
            elseif(NOT changes STREQUAL "")
                string(APPEND hash "-dirty")
            endif()
        endif()
    endif()
    string(REPLACE "-dirty" "" commit "${hash}")
    if(commit STREQUAL hash)
        set(dirty 0)
    else()
        set(dirty 1)
    endif()
    # file(CONFIGURE) keeps the time stamp when the text is the same.
    file(CONFIGURE OUTPUT ${HEADER} @ONLY CONTENT
[[/** Generated: the state of the sources that this build was made from. */
#ifndef VERSION_H
#define VERSION_H

#define HPMC_GIT_HASH "@hash@"
/** The same without "-dirty", and whether it was there. */
#define HPMC_GIT_COMMIT "@commit@"
#define HPMC_GIT_DIRTY @dirty@U

#endif
]])
    return()
endif()

set(_version_dir ${CMAKE_BINARY_DIR}/version)
add_custom_target(hpmc_version_header
    COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${CMAKE_SOURCE_DIR} -DHEADER=${_version_dir}/version.h
            -P ${CMAKE_CURRENT_LIST_FILE}
    BYPRODUCTS ${_version_dir}/version.h
    COMMENT "" VERBATIM)
add_library(hpmc_version INTERFACE)
add_dependencies(hpmc_version hpmc_version_header)
target_include_directories(hpmc_version INTERFACE ${_version_dir})
