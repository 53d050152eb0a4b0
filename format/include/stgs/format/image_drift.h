// SPDX-License-Identifier: Apache-2.0
// Camera-based quality metrics of a scene: the image-space drift of content that should be static,
// and the number of primitives covered by fewer than two cameras, whose depth is a guess.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/scene_file.h"

namespace stgs {

// Bound on the mean drift of static content, in pixels over the clip.
inline constexpr double kStaticDrift = 0.05;

// Drift of the primitives whose support covers the clip (ShownFrameTable::covers_clip()). The
// drift of a primitive is the mean over the cameras that cover it. A camera covers a primitive if
// the centre lies inside the image in the first or the last frame and beyond the near plane in
// both; occlusion is ignored. The centre moves along a straight line, and so does its projection,
// so path length, largest displacement and distance between first and last frame are equal.
struct ImageDrift {
  std::uint64_t primitives = 0;    // that cover the clip and are covered by a camera
  double mean = 0;                 // pixels over the clip
  double opacity_weighted = 0;     // pixels, mean weighted by O
  double median = 0;               // pixels
  std::uint64_t within_bound = 0;  // primitives with a drift of at most kStaticDrift
};

// Measures the drift between frames 0 and metadata.frames - 1. The result does not depend on the
// number of threads. Single precision limits the accuracy to about 1e-4 pixels.
ImageDrift image_drift(const Scene& scene, const std::vector<math::PinholeCamera>& cameras);

// Primitives by the number of cameras that cover them: the image holds the centre, beyond the near
// plane, at the shown frame nearest to T. Occlusion is ignored.
struct CameraCoverage {
  std::uint64_t by_none = 0;  // covered by no camera
  std::uint64_t by_one = 0;   // covered by exactly one
  std::uint64_t by_more = 0;  // covered by two or more
};

// Counts the cameras of each primitive. The result does not depend on the number of threads.
CameraCoverage camera_coverage(const Scene& scene, const std::vector<math::PinholeCamera>& cameras);

}  // namespace stgs
