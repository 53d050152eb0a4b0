// SPDX-License-Identifier: Apache-2.0
#include "train/foreground.h"

#include "stgs/format/math/project.h"
#include "stgs/format/parallel.h"
#include "train/random.h"

namespace stgs::encoder {
namespace {

constexpr double kMinShare = 0.75;

// Numbers of images and of masks that contain a point.
struct MaskCounts {
  int images = 0, masks = 0;
};

void count(const math::PinholeCamera& camera, const Image8& mask, const InitialPoint& point,
           MaskCounts& counts) {
  const math::Vec3 c =
      math::to_camera(camera, {point.position[0], point.position[1], point.position[2]});
  if (!(c.z >= camera.near_plane)) return;
  const float x = camera.fx * c.x / c.z + camera.cx, y = camera.fy * c.y / c.z + camera.cy;
  if (!(x >= 0 && y >= 0 && x < camera.width && y < camera.height)) return;
  const auto at = static_cast<std::size_t>(y) * mask.width + static_cast<std::size_t>(x);
  ++counts.images;
  if (mask.data[at] >= kMinMask) ++counts.masks;
}

}  // namespace

std::array<std::uint8_t, 3> mask_colour_of(std::size_t view) {
  Random random(0, view, RandomPurpose::kBackground);
  std::array<std::uint8_t, 3> colour{};
  for (std::uint8_t& channel : colour) channel = static_cast<std::uint8_t>(random.below(256));
  return colour;
}

math::Vec3 mask_background_of(std::size_t view) {
  const auto colour = mask_colour_of(view);
  constexpr float kUnit = 1.0f / 255.0f;  // as ground truth is converted
  return {kUnit * colour[0], kUnit * colour[1], kUnit * colour[2]};
}

Status keep_foreground(const PreparedCapture& capture, std::vector<InitialPoint>& statics) {
  std::vector<MaskCounts> counts(statics.size());
  for (const Camera& camera : capture.training_cameras()) {
    const math::PinholeCamera pinhole = camera.pinhole(capture.near_plane);
    for (const int frame : {0, capture.frames / 2, capture.frames - 1}) {
      STGS_ASSIGN(const Image8 mask, load_mask(capture, camera, frame));
      if (mask.data.empty()) return missing_mask(capture, camera, frame);
      parallel_for(std::size_t{0}, statics.size(),
                   [&](std::size_t i) { count(pinhole, mask, statics[i], counts[i]); });
    }
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < statics.size(); ++i) {
    const MaskCounts& s = counts[i];
    if (s.images > 0 && s.masks >= kMinShare * s.images) statics[kept++] = statics[i];
  }
  statics.resize(kept);
  return {};
}

Status check_masks(const PreparedCapture& capture) {
  for (const Camera& camera : capture.training_cameras()) {
    for (int frame = 0; frame < capture.frames; ++frame) {
      if (!has_mask(capture, camera, frame)) return missing_mask(capture, camera, frame);
    }
  }
  return {};
}

}  // namespace stgs::encoder
