// SPDX-License-Identifier: Apache-2.0
// What cameras can say of a scene: how far what stays for the whole clip wanders in their pictures
// (what is still should not), and how much of it fewer than two of them see (its depth is a guess).
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/scene_file.h"

namespace stgs {

// Pixels over the clip that what stands still may wander, as a mean.
inline constexpr double kStaticDrift = 0.05;

// Of the primitives whose support covers the clip (covers_clip of scene_statistics.h), each the
// mean over the cameras that see it. A camera sees a primitive whose centre lies inside the picture
// in the first or the last frame and before the near plane in both; what hides it is not asked. The
// centre moves straight and so does its projection: the length of its path over the clip, the
// largest displacement and the distance between its places in the first and last frame are one.
struct ImageDrift {
  std::uint64_t primitives = 0;    // that cover the clip and are seen
  double mean = 0;                 // pixels over the clip
  double opacity_weighted = 0;     // pixels, the mean with O as weight
  double median = 0;               // pixels
  std::uint64_t within_bound = 0;  // of the primitives: at most kStaticDrift
};

// Times in the scene's ticks, frames 0 to metadata.frames - 1. Does not depend on the number of
// threads; single precision leaves some 1e-4 pixels.
ImageDrift image_drift(const Scene& scene, const std::vector<math::PinholeCamera>& cameras);

// Primitives by how many cameras see them: those whose picture holds the centre, beyond the near
// plane, at the shown frame nearest to T. What hides it is not asked.
struct CameraCoverage {
  std::uint64_t by_none = 0, by_one = 0, by_more = 0;
};

// As for image_drift.
CameraCoverage camera_coverage(const Scene& scene, const std::vector<math::PinholeCamera>& cameras);

}  // namespace stgs
