# SPDX-License-Identifier: Apache-2.0
# stgs_module(NAME SOURCES files... LINK public libraries... PRIVATE private libraries...)
# makes the static library stgs_NAME with the include root include/ of the current folder. With
# CMAKE_UNITY_BUILD several sources are compiled as one, except CUDA sources and those that Highway
# compiles once per instruction set (*_vector.cpp).
include_guard()

function(stgs_module name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK;PRIVATE" ${ARGN})
  add_library(stgs_${name} STATIC ${arg_SOURCES})
  target_include_directories(stgs_${name} PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include
                             PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(stgs_${name} PUBLIC ${arg_LINK} PRIVATE ${arg_PRIVATE})
  set_target_properties(stgs_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  stgs_compile_options(stgs_${name})
  # Deferred to the end of the folder, because the folder adds sources.
  cmake_language(EVAL CODE "cmake_language(DEFER CALL stgs_compile_alone stgs_${name})")
endfunction()

function(stgs_compile_alone target)
  get_target_property(sources ${target} SOURCES)
  list(FILTER sources INCLUDE REGEX "(_vector\\.cpp|\\.cu)$")
  set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

# stgs_precompile(TARGET common|json|opencv|program|catch): with STGS_PRECOMPILED_HEADERS, compiles
# TARGET with precompiled headers of other libraries, which all targets of a set share: fmt and parts
# of the standard library; also nlohmann/json; also OpenCV; nlohmann/json for the program and Catch2
# for tests, both at -O1. Sources still include what they use, because other builds have no
# precompiled headers.
set(STGS_PRECOMPILED algorithm array cmath cstdint filesystem functional map memory optional span string
    vector fmt/format.h)
function(stgs_precompile target set)
  if(NOT STGS_PRECOMPILED_HEADERS)
    return()
  endif()
  if(NOT TARGET stgs_precompiled_${set})
    set(headers ${STGS_PRECOMPILED})
    set(libraries fmt::fmt)
    if(set MATCHES "^(json|opencv|program)$")
      list(APPEND headers nlohmann/json.hpp)
      list(APPEND libraries nlohmann_json::nlohmann_json)
    endif()
    if(set STREQUAL "opencv")
      list(APPEND headers opencv2/core.hpp opencv2/imgproc.hpp)
      list(APPEND libraries stgs_dep_opencv)
    endif()
    list(TRANSFORM headers REPLACE "(.+)" "<\\1>")
    if(set STREQUAL "catch")
      list(APPEND headers ${PROJECT_SOURCE_DIR}/tests/catch.h)
      list(APPEND libraries Catch2::Catch2)
    endif()
    set(source ${CMAKE_CURRENT_BINARY_DIR}/precompiled_${set}.cpp)
    file(CONFIGURE OUTPUT ${source} CONTENT "")
    add_library(stgs_precompiled_${set} OBJECT ${source})
    target_link_libraries(stgs_precompiled_${set} PRIVATE ${libraries})
    target_precompile_headers(stgs_precompiled_${set} PRIVATE ${headers})
    # The options that a precompiled header depends on are those of the targets that use it.
    stgs_compile_options(stgs_precompiled_${set})
    if(set MATCHES "^(program|catch)$")  # GCC 13 and later compare the optimisation level, too
      target_compile_options(stgs_precompiled_${set} PRIVATE $<$<CONFIG:Release>:-O1>)
    endif()
    if(NOT set STREQUAL "catch")
      set_target_properties(stgs_precompiled_${set} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    endif()
  endif()
  target_precompile_headers(${target} REUSE_FROM stgs_precompiled_${set})
endfunction()

# With STGS_BUNDLE_RUNTIME, copies the shared libraries of a program or module to lib/ beside it, the
# first folder in its RPATH, so that bin/ can be copied to another machine.
function(stgs_bundle_runtime program)
  if(STGS_BUNDLE_RUNTIME)
    get_target_property(type ${program} TYPE)
    set(kind EXECUTABLES)
    if(type STREQUAL "MODULE_LIBRARY")
      set(kind MODULES)
    endif()
    add_custom_command(TARGET ${program} POST_BUILD
      COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:${program}> -DKIND=${kind}
              -DFOLDER=$<TARGET_FILE_DIR:${program}>/lib -DOWN=${PROJECT_BINARY_DIR}/sdk
              -P ${PROJECT_SOURCE_DIR}/cmake/bundle_runtime.cmake
      COMMENT "Collecting the shared libraries of ${program}" VERBATIM)
  endif()
endfunction()
