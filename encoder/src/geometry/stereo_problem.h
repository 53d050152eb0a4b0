// SPDX-License-Identifier: Apache-2.0
// Stereo of one image against others: planes through pixels, and the projections between the
// cameras. Shared by the CPU and CUDA. Camera axes are OpenCV's; pixel centres are at +0.5.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/grad.h"
#include "stgs/format/math/project.h"

namespace stgs::encoder::geometry {

using math::Mat3;
using math::Vec3;

inline constexpr int kMaxSources = 4;  // images that one is compared with

// The plane of a pixel in camera space, through the pixel's ray at a depth.
struct Hypothesis {
  float depth;  // camera z, scene units
  Vec3 normal;  // unit, faces the camera
};

// A grey image and its camera. `corners` packs the pixel and its neighbours to the right, below,
// and below right, in this order from the lowest byte; those beyond the border repeat it.
struct StereoImage {
  const std::uint32_t* corners;  // width x height
  const float* depth;            // of an earlier pass, width x height, scene units; or null
  int width, height;
  float fx, fy, cx, cy;  // pixels
};

struct StereoSource {
  StereoImage image;
  // From the reference's camera space to the source's.
  Mat3 rotation;
  Vec3 translation;
  // From the reference's pixels: K_s R K_r^-1, the homography at infinity, and the epipole K_s t.
  Mat3 infinite;
  Vec3 epipole;
};

struct StereoProblem {
  StereoImage reference;
  StereoSource sources[kMaxSources];
  int source_count;
  float nearest, farthest;  // depths, scene units
  // Cost of a pixel of reprojection error with the depths of an earlier pass; 0: none is used.
  float consistency;
};

STGS_FN Vec3 ray_at(StereoImage image, float u, float v) {
  return math::vec3_of((u - image.cx) / image.fx, (v - image.cy) / image.fy, 1.0f);
}

// Grey value of pixel (x, y), 0 to 255.
STGS_FN float grey_at(StereoImage image, int x, int y) {
  const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width);
  return static_cast<float>(image.corners[at + static_cast<std::size_t>(x)] & 0xFFu);
}

// Sets the pose of a source from the poses of the reference and of the source in the world:
// p_camera = rotation p_world + translation.
STGS_FN StereoSource posed_source(StereoSource source, Mat3 from_rotation, Vec3 from_translation,
                                  Mat3 to_rotation, Vec3 to_translation) {
  const Mat3 b = from_rotation;
  source.rotation =
      math::mat3_of_columns(math::mat3_mul(to_rotation, math::vec3_of(b.xx, b.xy, b.xz)),
                            math::mat3_mul(to_rotation, math::vec3_of(b.yx, b.yy, b.yz)),
                            math::mat3_mul(to_rotation, math::vec3_of(b.zx, b.zy, b.zz)));
  const Vec3 moved = math::mat3_mul(source.rotation, from_translation);
  source.translation = math::vec3_add(to_translation, math::vec3_scale(moved, -1.0f));
  return source;
}

// Sets the derived members of a source.
STGS_FN StereoSource derived_source(StereoImage reference, StereoSource source) {
  const StereoImage s = source.image;
  const Mat3 r = source.rotation;
  const Vec3 t = source.translation;
  const float ix = 1.0f / reference.fx, iy = 1.0f / reference.fy;
  const float ox = reference.cx * ix, oy = reference.cy * iy;
  const Vec3 a = math::vec3_of(s.fx * r.xx + s.cx * r.zx, s.fx * r.xy + s.cx * r.zy,
                               s.fx * r.xz + s.cx * r.zz);
  const Vec3 b = math::vec3_of(s.fy * r.yx + s.cy * r.zx, s.fy * r.yy + s.cy * r.zy,
                               s.fy * r.yz + s.cy * r.zz);
  Mat3& h = source.infinite;
  h.xx = a.x * ix;
  h.xy = a.y * iy;
  h.xz = a.z - a.x * ox - a.y * oy;
  h.yx = b.x * ix;
  h.yy = b.y * iy;
  h.yz = b.z - b.x * ox - b.y * oy;
  h.zx = r.zx * ix;
  h.zy = r.zy * iy;
  h.zz = r.zz - r.zx * ox - r.zy * oy;
  source.epipole = math::vec3_of(s.fx * t.x + s.cx * t.z, s.fy * t.y + s.cy * t.z, t.z);
  return source;
}

// Returns the row n' K_r^-1 / n'x of a plane, with x on it: it maps the reference's pixels to the
// inverse of their depth.
STGS_FN Vec3 plane_row(StereoImage reference, float u, float v, Hypothesis plane) {
  const float unit = 1.0f / (plane.depth * math::dot3(plane.normal, ray_at(reference, u, v)));
  const float x = plane.normal.x * unit / reference.fx, y = plane.normal.y * unit / reference.fy;
  return math::vec3_of(x, y, plane.normal.z * unit - x * reference.cx - y * reference.cy);
}

// Returns the homography from the reference's pixels to the source's through the plane of a row.
STGS_FN Mat3 plane_homography(const StereoSource& source, Vec3 row) {
  Mat3 h = source.infinite;
  const Vec3 e = source.epipole;
  h.xx += e.x * row.x;
  h.xy += e.x * row.y;
  h.xz += e.x * row.z;
  h.yx += e.y * row.x;
  h.yy += e.y * row.y;
  h.yz += e.y * row.z;
  h.zx += e.z * row.x;
  h.zy += e.z * row.y;
  h.zz += e.z * row.z;
  return h;
}

// A point in a source: its pixel and camera z. The pixel is kNoPixel outside the image.
inline constexpr std::size_t kNoPixel = ~std::size_t{0};
struct SeenPoint {
  std::size_t pixel;
  float u, v, z;
};

// Projects the point of the reference's image position (u, v) at a depth into a source.
STGS_FN SeenPoint seen_point(StereoImage reference, const StereoSource& source, float u, float v,
                             float depth) {
  const StereoImage s = source.image;
  const Vec3 point = math::vec3_scale(ray_at(reference, u, v), depth);
  const Vec3 there = math::vec3_add(math::mat3_mul(source.rotation, point), source.translation);
  SeenPoint seen{kNoPixel, 0.0f, 0.0f, there.z};
  if (!(there.z > 0.0f)) return seen;
  seen.u = s.fx * there.x / there.z + s.cx;
  seen.v = s.fy * there.y / there.z + s.cy;
  if (seen.u >= 0.0f && seen.v >= 0.0f && seen.u < static_cast<float>(s.width) &&
      seen.v < static_cast<float>(s.height)) {
    const std::size_t row = static_cast<std::size_t>(seen.v) * static_cast<std::size_t>(s.width);
    seen.pixel = row + static_cast<std::size_t>(seen.u);
  }
  return seen;
}

// Returns how far the point at a depth returns from where it started, if it is projected into the
// source and back from the source's depth there, pixels; `none` where the source has no depth.
STGS_FN float reprojection_error(StereoImage reference, const StereoSource& source, float u,
                                 float v, float depth, float none) {
  const SeenPoint seen = seen_point(reference, source, u, v, depth);
  if (seen.pixel == kNoPixel) return none;
  const float found = source.image.depth[seen.pixel];
  if (!(found > 0.0f)) return none;
  const Vec3 there = math::vec3_scale(ray_at(source.image, seen.u, seen.v), found);
  const Vec3 back = math::mat3_transpose_mul(
      source.rotation, math::vec3_add(there, math::vec3_scale(source.translation, -1.0f)));
  if (!(back.z > 0.0f)) return none;
  const float du = reference.fx * back.x / back.z + reference.cx - u;
  const float dv = reference.fy * back.y / back.z + reference.cy - v;
  return std::sqrt(du * du + dv * dv);
}

// Returns the normal of unit length that faces the camera along the ray of (u, v).
STGS_FN Vec3 facing(StereoImage image, float u, float v, Vec3 normal) {
  const float length = std::sqrt(math::dot3(normal, normal));
  if (!(length > 1e-6f)) return math::vec3_of(0.0f, 0.0f, -1.0f);
  const float sign = math::dot3(normal, ray_at(image, u, v)) > 0.0f ? -1.0f : 1.0f;
  return math::vec3_scale(normal, sign / length);
}

// Returns the plane of pixel (from_u, from_v) as the hypothesis of pixel (u, v); depth 0 if it
// meets that pixel's ray outside the depth range.
STGS_FN Hypothesis moved_plane(StereoProblem problem, Hypothesis plane, float from_u, float from_v,
                               float u, float v) {
  const float before = math::dot3(plane.normal, ray_at(problem.reference, from_u, from_v));
  const float now = math::dot3(plane.normal, ray_at(problem.reference, u, v));
  plane.depth = now < -1e-4f ? plane.depth * before / now : 0.0f;
  if (!(plane.depth >= problem.nearest && plane.depth <= problem.farthest)) plane.depth = 0.0f;
  return plane;
}

}  // namespace stgs::encoder::geometry
