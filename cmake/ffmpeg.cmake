# SPDX-License-Identifier: Apache-2.0
# stgs_dep_ffmpeg: FFmpeg's libraries that read videos; ffmpeg_found.
include_guard()

add_library(stgs_dep_ffmpeg INTERFACE)
set(ffmpeg_found ON)
# The versions of FFmpeg 5.1.
foreach(needs avformat>=59.27 avcodec>=59.37 swscale>=6.7 avutil>=57.28)
  string(REGEX REPLACE ">.*" "" library ${needs})
  stgs_find(${library} PKG lib${needs} HEADER lib${library}/${library}.h LIBRARY ${library})
  target_link_libraries(stgs_dep_ffmpeg INTERFACE stgs_dep_${library})
  if(NOT STGS_FOUND_${library})
    set(ffmpeg_found OFF)
  endif()
endforeach()
