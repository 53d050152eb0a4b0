# SPDX-License-Identifier: Apache-2.0
# The C interface of the encoder: libstgs_encoder, separate from libstgs so that players do not depend
# on the libraries for preparing and training.
add_library(stgs_encoder_sdk_objects OBJECT
  src/encoder/encoder.cpp
  src/encoder/live.cpp
  src/encoder/live_settings.cpp
  src/encoder/pack.cpp
  src/encoder/prepare.cpp
  src/encoder/recorder.cpp
  src/encoder/train.cpp)
target_include_directories(stgs_encoder_sdk_objects PRIVATE include src)
target_link_libraries(stgs_encoder_sdk_objects PRIVATE stgs_encoder)
set_target_properties(stgs_encoder_sdk_objects PROPERTIES POSITION_INDEPENDENT_CODE ON)
stgs_compile_options(stgs_encoder_sdk_objects)
set(modules stgs_encoder)
set(module_objects $<TARGET_OBJECTS:stgs_encoder> $<TARGET_OBJECTS:stgs_capture>)
if(STGS_HAS_PREPARE)
  target_compile_definitions(stgs_encoder_sdk_objects PRIVATE STGS_HAS_PREPARE)
  list(APPEND modules stgs_prepare)
  list(APPEND module_objects $<TARGET_OBJECTS:stgs_prepare>)
endif()

set(map ${CMAKE_CURRENT_SOURCE_DIR}/stgs_encoder.map)
add_library(stgs_encoder_sdk SHARED $<TARGET_OBJECTS:stgs_encoder_sdk_objects> src/object.cpp)
target_include_directories(stgs_encoder_sdk PRIVATE include src)
target_link_libraries(stgs_encoder_sdk PRIVATE ${modules})
target_link_options(stgs_encoder_sdk PRIVATE LINKER:--version-script=${map})
set_target_properties(stgs_encoder_sdk PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION 0
                      LINK_DEPENDS ${map})
stgs_compile_options(stgs_encoder_sdk)
# libstgs names its results, opens its scenes, and contains the modules that both share.
target_link_libraries(stgs_encoder_sdk INTERFACE stgs_sdk)
add_library(stgs_encoder_sdk_static STATIC
  $<TARGET_OBJECTS:stgs_encoder_sdk_objects> ${module_objects})
set(libraries xxhash)
if(STGS_HAS_PREPARE)
  foreach(module core imgproc imgcodecs video calib3d features2d flann)
    list(APPEND libraries opencv_${module})
  endforeach()
  list(APPEND libraries avformat avcodec swscale avutil)
endif()
if(STGS_HAS_CALIBRATION)
  list(APPEND libraries tomlplusplus pugixml)
endif()
target_link_libraries(stgs_encoder_sdk_static INTERFACE stgs_sdk_static ${libraries})
list(TRANSFORM libraries PREPEND "-l")
list(JOIN libraries " " STGS_ENCODER_PC_LIBRARIES)

foreach(target stgs_encoder_sdk stgs_encoder_sdk_static)
  set_target_properties(${target} PROPERTIES OUTPUT_NAME stgs_encoder LINKER_LANGUAGE CXX)
endforeach()
set_target_properties(stgs_encoder_sdk PROPERTIES EXPORT_NAME encoder)
set_target_properties(stgs_encoder_sdk_static PROPERTIES EXPORT_NAME encoder_static)
add_library(stgs::encoder ALIAS stgs_encoder_sdk)
add_library(stgs::encoder_static ALIAS stgs_encoder_sdk_static)
