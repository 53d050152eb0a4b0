# SPDX-License-Identifier: Apache-2.0
# Builds the examples with the installed libraries: cmake -S . -B BUILD && cmake --build BUILD
cmake_minimum_required(VERSION 3.25)
project(stgs_encoder_examples LANGUAGES C CXX)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
find_package(stgs REQUIRED COMPONENTS encoder)
find_package(Threads REQUIRED)

add_executable(encode encode.c)
add_executable(telepresence_cameras telepresence_cameras.cpp)
add_executable(telepresence_recorder telepresence_recorder.cpp)
foreach(program encode telepresence_cameras telepresence_recorder)
  target_link_libraries(${program} PRIVATE stgs::encoder)
endforeach()
target_link_libraries(telepresence_cameras PRIVATE Threads::Threads)
