// SPDX-License-Identifier: Apache-2.0
// The camera and the time of a frame, for the shaders of both renderers. The shader declares
// `view`, six vectors: the rows of the pose with the translation in w; (fx, fy, cx, cy); (width,
// height, near plane, kernel of the splats); the centre of the camera.
#ifndef STGS_WEB_SPLAT_VIEW_H
#define STGS_WEB_SPLAT_VIEW_H

#include "stgs/format/math/project.h"

STGS_FN PinholeCamera camera_of_view() {
  PinholeCamera camera;
  camera.rotation = mat3_of_columns(vec3_of(view[0].x, view[1].x, view[2].x),
                                    vec3_of(view[0].y, view[1].y, view[2].y),
                                    vec3_of(view[0].z, view[1].z, view[2].z));
  camera.translation = vec3_of(view[0].w, view[1].w, view[2].w);
  camera.fx = view[3].x;
  camera.fy = view[3].y;
  camera.cx = view[3].z;
  camera.cy = view[3].w;
  camera.width = view[4].x;
  camera.height = view[4].y;
  camera.near_plane = view[4].z;
  return camera;
}

STGS_FN int kernel_of_view() {
  return view[4].w == 1.0f ? kBandLimited : kDilated;
}

// Returns t - T, compensated for the rounding of t and of the difference.
STGS_FN float since(float ticks, float ticks_rest, float time) {
  float difference = ticks - time;
  float back = difference - ticks;
  float rounding = (ticks - (difference - back)) - (time + back);
  return difference + (rounding + ticks_rest);
}

#endif
