# SPDX-License-Identifier: Apache-2.0
# Every option of the build. Optional parts: ON requires the dependencies, AUTO uses them if they
# are found, OFF leaves the part out. A part that is left out answers with exit code 6 on the
# command line and with STGS_ERROR_NOT_BUILT in the library.
#
# In another project (add_subdirectory, FetchContent) the defaults build the player library only,
# and install nothing.
include_guard()

if(PROJECT_IS_TOP_LEVEL)
  set(stgs_default AUTO)
else()
  set(stgs_default OFF)
endif()

function(stgs_option name default text)
  set(STGS_WITH_${name} ${default} CACHE STRING "${text} (ON, AUTO or OFF)")
  set_property(CACHE STGS_WITH_${name} PROPERTY STRINGS AUTO ON OFF)
endfunction()

# The encoder and its parts.
stgs_option(ENCODER ${stgs_default} "Preparing captures, training and packing: libstgs_encoder and the verbs prepare, train, pack, encode")
stgs_option(PREPARE AUTO "OpenCV and FFmpeg's libraries: reading captures, calibration, initial points, mp4 output")
stgs_option(CALIBRATION AUTO "toml++ and pugixml: calibrations of Pose2Sim, Anipose and Qualisys")
stgs_option(CUDNN AUTO "cuDNN 9 headers: the perceptual loss on an NVIDIA GPU")
stgs_option(NCCL AUTO "NCCL header: training on several NVIDIA GPUs")
stgs_option(MPI AUTO "MPI: training with several processes")
# The player and its parts.
stgs_option(VULKAN AUTO "Vulkan headers, volk and glslc: rendering with Vulkan")
stgs_option(CUDA ${stgs_default} "CUDA toolkit: rendering and training on an NVIDIA GPU")
stgs_option(HTTP AUTO "libcurl: scenes from URLs")
stgs_option(DRACO AUTO "libdraco: the profile draco")
stgs_option(SOG AUTO "libwebp and libzip: reading SOG models")
# The program and its parts.
option(STGS_BUILD_PROGRAM "Build the program stgs (needs CLI11 and stb)" ${PROJECT_IS_TOP_LEVEL})
stgs_option(PLAY AUTO "GLFW and Dear ImGui: the verb play, a window with Vulkan")
stgs_option(SERVE AUTO "libmicrohttpd: the verb serve, which needs the player for browsers (STGS_WITH_WEB)")
stgs_option(EXR AUTO "OpenEXR: colour and depth output as EXR")
# Bindings and examples.
option(STGS_BUILD_EXAMPLES "Build the examples of the SDK" ${PROJECT_IS_TOP_LEVEL})
stgs_option(PYTHON ${stgs_default} "Python, numpy and pybind11: the Python module")
stgs_option(WEB ${stgs_default} "Emscripten, TypeScript and esbuild: the player for browsers, the verb web")
stgs_option(OPENXR AUTO "OpenXR loader and headers: the example hello_openxr")
# BUILD_TESTING is CTest's name for the same switch.
set(tests ${PROJECT_IS_TOP_LEVEL})
if(DEFINED BUILD_TESTING AND NOT BUILD_TESTING)
  set(tests OFF)
endif()
option(STGS_BUILD_TESTS "Build the tests and benchmarks" ${tests})
unset(tests)
option(STGS_INSTALL "Generate install rules, the CMake package and the Debian packages"
       ${PROJECT_IS_TOP_LEVEL})

# How it is compiled.
option(STGS_WARNINGS_AS_ERRORS "Treat compiler warnings as errors" OFF)
option(STGS_PRECOMPILED_HEADERS "Precompile headers of other libraries, which halves the build time" OFF)
option(STGS_CCACHE "Compile through ccache if it is installed" ${PROJECT_IS_TOP_LEVEL})
option(STGS_COVERAGE "Count executed lines; adds the target coverage (gcovr)" OFF)
option(STGS_FUZZER "Build the programs of tests/fuzz that a fuzzing engine drives (clang)" OFF)
set(STGS_FUZZ_ENGINE "-fsanitize=fuzzer" CACHE STRING "Linker flag or library of the fuzzing engine, such as \$LIB_FUZZING_ENGINE of OSS-Fuzz")
set(STGS_SANITIZE "" CACHE STRING "Sanitizers, as given to -fsanitize= (address,undefined or thread)")
option(STGS_BUNDLE_RUNTIME "Copy shared libraries that are not system libraries beside the binary" OFF)
