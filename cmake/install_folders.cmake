# SPDX-License-Identifier: Apache-2.0
# Where files are installed below the prefix.
include_guard()

# Debian's multiarch folder, also below /usr/local: one build serves both `cmake --install` and the
# packages.
if(PROJECT_IS_TOP_LEVEL AND NOT DEFINED CMAKE_INSTALL_LIBDIR AND CMAKE_LIBRARY_ARCHITECTURE
   AND EXISTS /etc/debian_version)
  set(CMAKE_INSTALL_LIBDIR lib/${CMAKE_LIBRARY_ARCHITECTURE} CACHE PATH "Libraries, from the prefix")
endif()
include(GNUInstallDirs)
# Modules that the program loads at run time.
set(STGS_INSTALL_MODULEDIR ${CMAKE_INSTALL_LIBDIR}/stgs)
