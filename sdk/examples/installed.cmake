# SPDX-License-Identifier: Apache-2.0
# Builds the examples with the installed library: cmake -S . -B BUILD && cmake --build BUILD
cmake_minimum_required(VERSION 3.25)
project(stgs_examples LANGUAGES C CXX)
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
find_package(stgs REQUIRED COMPONENTS shared)

add_executable(player player.cpp)
add_executable(telepresence_viewer telepresence_viewer.cpp)
foreach(program player telepresence_viewer)
  target_link_libraries(${program} PRIVATE stgs::stgs)
endforeach()

find_path(STB_INCLUDE_DIR stb_image_write.h PATH_SUFFIXES stb)
if(NOT STB_INCLUDE_DIR)
  message(STATUS "stb not found (libstb-dev; writes PNG): "
                 "minimal, embed_vulkan and hello_openxr are left out")
  return()
endif()
add_executable(minimal minimal.c)
target_include_directories(minimal SYSTEM PRIVATE ${STB_INCLUDE_DIR})
target_link_libraries(minimal PRIVATE stgs::stgs m)

find_package(Vulkan COMPONENTS glslc)
if(NOT (Vulkan_FOUND AND Vulkan_GLSLC_EXECUTABLE))
  message(STATUS "Vulkan or glslc not found (libvulkan-dev, glslc): "
                 "embed_vulkan and hello_openxr are left out")
  return()
endif()
include(app/app.cmake)
target_link_libraries(stgs_example_app PUBLIC stgs::stgs)
add_executable(embed_vulkan embed_vulkan.cpp)
target_link_libraries(embed_vulkan PRIVATE stgs_example_app)

find_package(OpenXR)
if(NOT OpenXR_FOUND)
  message(STATUS "OpenXR not found (libopenxr-dev): hello_openxr is left out")
  return()
endif()
add_executable(hello_openxr hello_openxr.cpp xr/eye_view.cpp xr/session.cpp)
target_link_libraries(hello_openxr PRIVATE stgs_example_app OpenXR::openxr_loader)
