# SPDX-License-Identifier: Apache-2.0
# Language standards, compiler flags and output folders. Variables set here apply to this directory
# and those below it; a project that includes this one keeps its own.
include_guard()

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
if(PROJECT_IS_TOP_LEVEL)
  set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
  endif()
endif()
if(STGS_BUNDLE_RUNTIME)
  list(APPEND CMAKE_BUILD_RPATH "$ORIGIN/lib")
endif()

if(STGS_SANITIZE)
  add_compile_options(-fsanitize=${STGS_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${STGS_SANITIZE})
endif()
if(STGS_FUZZER)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "STGS_FUZZER needs clang (-DCMAKE_CXX_COMPILER=clang++)")
  endif()
  # Other engines instrument by the compiler or the flags of the environment.
  if(STGS_FUZZ_ENGINE STREQUAL "-fsanitize=fuzzer")
    add_compile_options(-fsanitize=fuzzer-no-link)
  endif()
endif()
include(${CMAKE_CURRENT_LIST_DIR}/hardening.cmake)
if(STGS_COVERAGE)
  # Counters are updated atomically: several threads run the same lines.
  add_compile_options($<$<COMPILE_LANGUAGE:C,CXX>:--coverage> $<$<COMPILE_LANGUAGE:C,CXX>:-fprofile-update=atomic>)
  add_link_options(--coverage)
endif()

if(STGS_CCACHE)
  find_program(CCACHE_PROGRAM ccache)
  if(CCACHE_PROGRAM)
    # ccache caches compilations with a precompiled header only if it may trust the time stamps in it.
    set(launcher ${CCACHE_PROGRAM})
    if(STGS_PRECOMPILED_HEADERS)
      set(launcher ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime ${CCACHE_PROGRAM})
    endif()
    foreach(language C CXX CUDA)
      if(NOT CMAKE_${language}_COMPILER_LAUNCHER)
        set(CMAKE_${language}_COMPILER_LAUNCHER ${launcher})
      endif()
    endforeach()
  endif()
endif()

function(stgs_compile_options target)
  # -pthread everywhere: precompiled headers cannot be shared between targets with and without it.
  target_compile_options(${target} PRIVATE
    $<$<COMPILE_LANGUAGE:CXX>:-pthread>
    $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion>
    $<$<AND:$<BOOL:${STGS_WARNINGS_AS_ERRORS}>,$<COMPILE_LANGUAGE:CXX>>:-Werror>
    # GCC 12 has false positives at -O3, in strings and vectors.
    $<$<AND:$<CONFIG:Release>,$<COMPILE_LANG_AND_ID:CXX,GNU>>:-Wno-array-bounds -Wno-restrict
      -Wno-stringop-overflow -Wno-stringop-overread>
    # Several sources compiled as one: none of them is the main file, whose types may be private.
    $<$<AND:$<BOOL:${CMAKE_UNITY_BUILD}>,$<COMPILE_LANG_AND_ID:CXX,GNU>>:-Wno-subobject-linkage>
    $<$<COMPILE_LANGUAGE:CXX>:-fno-math-errno>)
endfunction()
