# SPDX-License-Identifier: Apache-2.0
# stgs_dep_ffmpeg: FFmpeg's libraries that read videos; ffmpeg_found.
include_guard()

add_library(stgs_dep_ffmpeg INTERFACE)
set(ffmpeg_found ON)
foreach(library avformat avcodec swscale avutil)
  stgs_find(${library} PKG lib${library} HEADER lib${library}/${library}.h LIBRARY ${library})
  target_link_libraries(stgs_dep_ffmpeg INTERFACE stgs_dep_${library})
  if(NOT STGS_FOUND_${library})
    set(ffmpeg_found OFF)
  endif()
endforeach()
