# SPDX-License-Identifier: Apache-2.0
# stgs_module(NAME SOURCES files... LINK public libraries... PRIVATE private libraries...)
# makes the static library stgs_NAME (alias stgs::NAME) with the one include root NAME/include.
include_guard()

function(stgs_compile_options target)
  target_compile_options(${target} PRIVATE
    $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion>
    $<$<AND:$<BOOL:${STGS_WARNINGS_AS_ERRORS}>,$<COMPILE_LANGUAGE:CXX>>:-Werror>
    $<$<COMPILE_LANGUAGE:CXX>:-fno-math-errno>)
endfunction()

function(stgs_module name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK;PRIVATE" ${ARGN})
  add_library(stgs_${name} STATIC ${arg_SOURCES})
  if(NOT TARGET stgs::${name})  # stgs::format stands for several libraries
    add_library(stgs::${name} ALIAS stgs_${name})
  endif()
  target_include_directories(stgs_${name} PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include
                             PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(stgs_${name} PUBLIC ${arg_LINK} PRIVATE ${arg_PRIVATE})
  set_target_properties(stgs_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  stgs_compile_options(stgs_${name})
endfunction()

# With STGS_BUNDLE_RUNTIME, copies the shared libraries that a program needs to lib/ beside it, where
# every program of the build looks first, so that bin/ can be copied to another machine.
function(stgs_bundle_runtime program)
  if(STGS_BUNDLE_RUNTIME)
    add_custom_command(TARGET ${program} POST_BUILD
      COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:${program}>
              -DFOLDER=$<TARGET_FILE_DIR:${program}>/lib
              -P ${PROJECT_SOURCE_DIR}/cmake/bundle_runtime.cmake
      COMMENT "Collecting what ${program} needs at run time" VERBATIM)
  endif()
endfunction()
