# SPDX-License-Identifier: Apache-2.0
# Run as a script: cmake -DPROGRAM=FILE -DKIND=EXECUTABLES|MODULES -DFOLDER=DIR -DOWN=DIR
#                        -P bundle_runtime.cmake
# Copies the shared libraries that PROGRAM, an executable or a module, needs into FOLDER, except
# those that every Linux machine has (glibc, the C++ runtime) and those that belong to a driver.
# OWN is the folder with the shared libraries of this build.
cmake_minimum_required(VERSION 3.25)

# A program finds the copies before the libraries, so copies from an earlier build are renewed first.
file(GLOB own ${OWN}/*.so*)
foreach(library IN LISTS own)
  get_filename_component(name ${library} NAME)
  if(EXISTS ${FOLDER}/${name})
    file(COPY ${library} DESTINATION ${FOLDER})
  endif()
endforeach()

file(GET_RUNTIME_DEPENDENCIES
  ${KIND} ${PROGRAM}
  RESOLVED_DEPENDENCIES_VAR found
  UNRESOLVED_DEPENDENCIES_VAR missing
  CONFLICTING_DEPENDENCIES_PREFIX conflict
  PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|rt|pthread|resolv|stdc\\+\\+|gcc_s)\\.so" "^libcuda\\.so" "^libnvidia")
if(missing)
  message(FATAL_ERROR "${PROGRAM} needs libraries that are not here: ${missing}")
endif()
# One that the program finds in FOLDER and another library in the system is a copy of a run before.
foreach(name IN LISTS conflict_FILENAMES)
  if(NOT "${FOLDER}/${name}" IN_LIST conflict_${name})
    message(FATAL_ERROR "${PROGRAM} finds more than one ${name}: ${conflict_${name}}")
  endif()
endforeach()
foreach(library IN LISTS found)
  get_filename_component(name ${library} NAME)
  # Already the copy, on a second run.
  if(NOT library STREQUAL "${FOLDER}/${name}")
    file(COPY ${library} DESTINATION ${FOLDER} FOLLOW_SYMLINK_CHAIN)
  endif()
endforeach()
