# SPDX-License-Identifier: Apache-2.0
# Installs libraries, headers, examples, the CMake package and the pkg-config files.
include(CMakePackageConfigHelpers)

# One export per component, so that each may be absent.
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/stgs)
install(TARGETS stgs_sdk EXPORT stgs-shared
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT dev)
install(TARGETS stgs_sdk_static EXPORT stgs-static
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
foreach(component shared static)
  install(EXPORT stgs-${component} NAMESPACE stgs:: DESTINATION ${package_folder} COMPONENT dev)
endforeach()
install(DIRECTORY include/stgs DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev
        PATTERN "stgs_encoder*" EXCLUDE)
# Examples that need only this library; the encoder component has the others.
set(examples ${CMAKE_INSTALL_DATADIR}/doc/libstgs-dev/examples)
install(DIRECTORY examples/app examples/xr DESTINATION ${examples} COMPONENT dev)
install(FILES examples/minimal.c examples/player.cpp examples/telepresence_viewer.cpp
              examples/embed_vulkan.cpp examples/hello_openxr.cpp
        DESTINATION ${examples} COMPONENT dev)
install(FILES examples/installed.cmake DESTINATION ${examples} RENAME CMakeLists.txt COMPONENT dev)
configure_package_config_file(packaging/stgsConfig.cmake.in stgsConfig.cmake
  INSTALL_DESTINATION ${package_folder} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/stgsConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/stgsConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/stgsConfigVersion.cmake
        DESTINATION ${package_folder} COMPONENT dev)
# Relative, so that the installation is relocatable.
file(RELATIVE_PATH STGS_PC_PREFIX /p/${CMAKE_INSTALL_LIBDIR}/pkgconfig /p)
configure_file(packaging/stgs.pc.in stgs.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/stgs.pc
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)

if(NOT STGS_HAS_ENCODER)
  return()
endif()
configure_file(packaging/stgs_encoder.pc.in stgs_encoder.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/stgs_encoder.pc
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT encoder_dev)
install(TARGETS stgs_encoder_sdk EXPORT stgs-encoder
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT encoder NAMELINK_COMPONENT encoder_dev)
install(TARGETS stgs_encoder_sdk_static EXPORT stgs-encoder_static
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT encoder_dev)
foreach(component encoder encoder_static)
  install(EXPORT stgs-${component} NAMESPACE stgs:: COMPONENT encoder_dev
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/stgs)
endforeach()
install(FILES include/stgs/stgs_encoder.h include/stgs/stgs_encoder_live.h
              include/stgs/stgs_encoder_recorder.h include/stgs/stgs_encoder.hpp
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/stgs COMPONENT encoder_dev)
set(examples ${CMAKE_INSTALL_DATADIR}/doc/libstgs-encoder-dev/examples)
install(FILES examples/encode.c examples/telepresence_cameras.cpp examples/telepresence_recorder.cpp
        DESTINATION ${examples} COMPONENT encoder_dev)
install(FILES examples/installed_encoder.cmake
        DESTINATION ${examples} RENAME CMakeLists.txt COMPONENT encoder_dev)
