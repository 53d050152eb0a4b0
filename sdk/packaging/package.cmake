# SPDX-License-Identifier: Apache-2.0
# Debian packages, one per install component: `cmake --build BUILD`, then `cpack -G DEB` in BUILD.
# dpkg-shlibdeps derives dependencies from linked libraries.
set(STGS_PACKAGE_MAINTAINER "STGS maintainers <stgs@example.org>" CACHE STRING
    "Maintainer of the Debian packages: NAME <ADDRESS>")

set(packages runtime dev)
if(STGS_HAS_ENCODER)
  list(APPEND packages encoder encoder_dev)
endif()
if(STGS_BUILD_PROGRAM)
  list(APPEND packages tools)
endif()
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME libstgs0)  # 0: the SOVERSION
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libstgs-dev)
set(CPACK_DEBIAN_DOC_PACKAGE_NAME libstgs-doc)
set(CPACK_DEBIAN_ENCODER_PACKAGE_NAME libstgs-encoder0)
set(CPACK_DEBIAN_ENCODER_DEV_PACKAGE_NAME libstgs-encoder-dev)
set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME stgs)
set(CPACK_DEBIAN_MPI_PACKAGE_NAME stgs-mpi)
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-stgs)
if(TARGET docs)
  list(APPEND packages doc)
endif()
if(STGS_HAS_MPI)
  list(APPEND packages mpi)
endif()
if(STGS_HAS_PYTHON)
  list(APPEND packages python)
endif()

# The first line of a description is its synopsis; CPack would put that of the project before it.
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION "player of streaming 4D Gaussian video - library
Opens .stgs scenes from files, URLs, memory or application callbacks and renders
them at any time from any viewpoint, on the CPU, with Vulkan or, if built in,
with CUDA.")
set(CPACK_COMPONENT_DEV_DESCRIPTION "player of streaming 4D Gaussian video - development files
C99 headers, static library, CMake and pkg-config files, and examples for
applications that render .stgs scenes.")
set(CPACK_COMPONENT_DOC_DESCRIPTION "streaming 4D Gaussian video - documentation
Guide of the program stgs, guide and reference of the libraries libstgs and
libstgs-encoder, and the specification of the .stgs format, as HTML.")
set(CPACK_COMPONENT_ENCODER_DESCRIPTION "encoder of streaming 4D Gaussian video - library
Turns synchronised multi-view video into .stgs scenes of 4D Gaussians: prepares
captures, trains, and packs.")
set(CPACK_COMPONENT_ENCODER_DEV_DESCRIPTION "encoder of streaming 4D Gaussian video - development files
C99 headers, static library, CMake and pkg-config files for applications that
make .stgs scenes.")
set(CPACK_COMPONENT_TOOLS_DESCRIPTION "streaming 4D Gaussian video - encoder, player, tools
The program stgs turns synchronised multi-view video into .stgs files of 4D
Gaussians, and plays, renders, compares, validates and converts such files.")
set(CPACK_COMPONENT_MPI_DESCRIPTION "streaming 4D Gaussian video - training with several processes
Loaded by the program stgs when mpirun or srun starts it.")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "player of streaming 4D Gaussian video - Python module
Opens .stgs scenes, renders them into NumPy arrays and returns their primitives.")

set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DOC_PACKAGE_SECTION doc)
set(CPACK_DEBIAN_DOC_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_ENCODER_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_ENCODER_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION video)
set(CPACK_DEBIAN_MPI_PACKAGE_SECTION video)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(same_version "(= ${PROJECT_VERSION}-1)")
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "libstgs0 ${same_version}")
set(CPACK_DEBIAN_ENCODER_DEV_PACKAGE_DEPENDS
    "libstgs-encoder0 ${same_version}, libstgs-dev ${same_version}")
set(CPACK_DEBIAN_MPI_PACKAGE_DEPENDS "stgs ${same_version}")
if(STGS_HAS_PYTHON)
  # An extension module is specific to a minor version of Python.
  math(EXPR next_minor "${Python_VERSION_MINOR} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "libstgs0 ${same_version}, python3-numpy, \
python3 (>= 3.${Python_VERSION_MINOR}~), python3 (<< 3.${next_minor})")
endif()
# Libraries and programs used at run time. The Vulkan driver depends on the machine.
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS "libvulkan1, mesa-vulkan-drivers | vulkan-icd")
set(CPACK_DEBIAN_TOOLS_PACKAGE_RECOMMENDS "libvulkan1, mesa-vulkan-drivers | vulkan-icd")
set(CPACK_DEBIAN_ENCODER_PACKAGE_SUGGESTS "colmap")
set(CPACK_DEBIAN_TOOLS_PACKAGE_SUGGESTS "colmap, ffmpeg, libstgs-doc, stgs-mpi")
# Dependencies that dpkg-shlibdeps gives to programs that link the library: before 1.0 exactly the
# version that they were built with.
set(documents ${PROJECT_BINARY_DIR}/packaging)
file(WRITE ${documents}/shlibs "libstgs 0 libstgs0 ${same_version}\n")
file(WRITE ${documents}/encoder/shlibs "libstgs_encoder 0 libstgs-encoder0 ${same_version}\n")
file(WRITE ${documents}/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA ${documents}/shlibs ${documents}/triggers)
set(CPACK_DEBIAN_ENCODER_PACKAGE_CONTROL_EXTRA ${documents}/encoder/shlibs ${documents}/triggers)
# Libraries that programs with stgs::static link.
set(static_needs libfmt-dev libdeflate-dev libhwy-dev)
if(STGS_HAS_DRACO)
  list(APPEND static_needs libdraco-dev)
endif()
if(STGS_HAS_HTTP)
  list(APPEND static_needs libcurl4-openssl-dev)
endif()
list(JOIN static_needs ", " CPACK_DEBIAN_DEV_PACKAGE_RECOMMENDS)
if(STGS_HAS_PREPARE)
  set(CPACK_DEBIAN_ENCODER_DEV_PACKAGE_RECOMMENDS
      "libopencv-core-dev, libopencv-imgproc-dev, libopencv-imgcodecs-dev, libopencv-video-dev, \
libopencv-calib3d-dev, libopencv-features2d-dev, libopencv-flann-dev, \
libavformat-dev, libavcodec-dev, libswscale-dev, libavutil-dev")
endif()
if(STGS_HAS_CALIBRATION)
  string(APPEND CPACK_DEBIAN_ENCODER_DEV_PACKAGE_RECOMMENDS ", libtomlplusplus-dev, libpugixml-dev")
endif()
set(CPACK_DEBIAN_DEV_PACKAGE_SUGGESTS "libstgs-doc, stgs, cmake, pkg-config, libstb-dev, libvulkan-dev")

set(CPACK_PACKAGE_NAME stgs)
set(CPACK_PACKAGE_VENDOR STGS)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER ${STGS_PACKAGE_MAINTAINER})
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL ${packages})
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/sdk)  # for the Python module
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

# Debian requires licence and changelog in every package. Header-only and archive-only libraries are
# compiled in; their licences are the copyright files of their Debian packages.
set(compiled_into_runtime libvulkan-volk-dev)
set(compiled_into_dev libvulkan-volk-dev)
set(compiled_into_encoder nlohmann-json3-dev libnanoflann-dev libstb-dev)
set(compiled_into_encoder_dev ${compiled_into_encoder})
set(compiled_into_tools libvulkan-volk-dev libcli11-dev nlohmann-json3-dev
    libnanoflann-dev libstb-dev libimgui-dev)
if(STGS_HAS_WEB)
  list(APPEND compiled_into_tools emscripten libfmt-dev libhwy-dev)
endif()
set(compiled_into_python pybind11-dev)
find_program(GZIP_PROGRAM gzip)
configure_file(sdk/packaging/copyright.in ${documents}/copyright @ONLY)
string(TIMESTAMP STGS_PACKAGE_DATE "%a, %d %b %Y %H:%M:%S +0000" UTC)
configure_file(sdk/packaging/changelog.in ${documents}/changelog.Debian @ONLY)
file(COPY_FILE ${PROJECT_SOURCE_DIR}/CHANGELOG.md ${documents}/changelog)
if(GZIP_PROGRAM)
  execute_process(COMMAND ${GZIP_PROGRAM} -9nf changelog changelog.Debian
                  WORKING_DIRECTORY ${documents} COMMAND_ERROR_IS_FATAL ANY)
endif()
foreach(component IN LISTS packages)
  string(TOUPPER ${component} upper)
  set(folder ${CMAKE_INSTALL_DATADIR}/doc/${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  install(FILES ${documents}/copyright DESTINATION ${folder} COMPONENT ${component})
  if(GZIP_PROGRAM)
    install(FILES ${documents}/changelog.gz ${documents}/changelog.Debian.gz DESTINATION ${folder}
            COMPONENT ${component})
  endif()
  foreach(library IN LISTS compiled_into_${component})
    if(EXISTS /usr/share/doc/${library}/copyright)
      install(FILES /usr/share/doc/${library}/copyright DESTINATION ${folder}/third-party
              RENAME ${library} COMPONENT ${component})
    endif()
  endforeach()
endforeach()
include(CPack)
