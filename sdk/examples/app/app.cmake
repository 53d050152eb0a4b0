# SPDX-License-Identifier: Apache-2.0
# stgs_example_app, shared by embed_vulkan and hello_openxr. Needs Vulkan::Vulkan, glslc and
# STB_INCLUDE_DIR. The including file adds the headers of the library.
add_library(stgs_example_app STATIC
  ${CMAKE_CURRENT_LIST_DIR}/compositor.cpp ${CMAKE_CURRENT_LIST_DIR}/gpu.cpp)
foreach(shader geometry.vert geometry.frag composite.vert composite.frag)
  set(spirv ${CMAKE_CURRENT_BINARY_DIR}/${shader}.inc)
  set(source ${CMAKE_CURRENT_LIST_DIR}/${shader})
  add_custom_command(
    OUTPUT ${spirv}
    COMMAND ${Vulkan_GLSLC_EXECUTABLE} --target-env=vulkan1.1 -O -Werror -mfmt=num -o ${spirv} ${source}
    DEPENDS ${source}
    COMMENT "Compiling ${shader}")
  target_sources(stgs_example_app PRIVATE ${spirv})
endforeach()
target_include_directories(stgs_example_app PRIVATE ${CMAKE_CURRENT_BINARY_DIR})
target_include_directories(stgs_example_app SYSTEM PRIVATE ${STB_INCLUDE_DIR})
target_link_libraries(stgs_example_app PUBLIC Vulkan::Vulkan)
