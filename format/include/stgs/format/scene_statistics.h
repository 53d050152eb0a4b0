// SPDX-License-Identifier: Apache-2.0
// Statistics of the lifespans and speeds of a scene's primitives.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// A primitive that covers the clip is static if it moves by at most this share of the scene radius
// over the clip: about half a pixel for a camera one radius away with a focal length of 500 pixels.
inline constexpr double kStaticShare = 1e-3;

// Values in [from, to).
struct HistogramBin {
  double from = 0;
  double to = std::numeric_limits<double>::infinity();
  std::uint64_t count = 0;
};

struct SceneStatistics {
  std::uint64_t primitives = 0;
  std::uint64_t never_visible = 0;  // O below the threshold 1/255; not counted below
  double clip_seconds = 0;          // frames x tick
  // Distance from the median position within which 95 % of the positions lie.
  double scene_radius = 0;  // scene units

  // Histogram of the support length 2 (r + sigma sqrt(ln(O / threshold))), seconds. Each bin edge
  // is twice the previous one; the last is the length of the clip. Primitives whose support covers
  // every frame are counted in whole_clip instead.
  std::vector<HistogramBin> lifespans;
  std::uint64_t whole_clip = 0;
  double median_lifespan = 0;  // seconds, of all visible primitives

  // Histogram of the effective speed |u|, scene units per second; two bins per decade.
  std::vector<HistogramBin> speeds;
  double median_speed = 0;

  double static_bound = 0;              // scene units over the clip: kStaticShare * scene_radius
  std::uint64_t static_primitives = 0;  // cover the clip and move by at most static_bound
  double whole_clip_drift = 0;  // mean motion of primitives that cover the clip, scene units

  // Returns the share of static primitives among the visible ones; 0 if none is visible.
  double static_share() const;
};

// Computes the statistics of a scene.
SceneStatistics scene_statistics(const Scene& scene);

// The first and last frame at which a primitive can be shown, in ticks. In a scene with parts these
// are the frames of its part, which then stands for the clip.
struct ShownFrames {
  double first = 0, last = 0;
  double part_begin = 0;  // the primitive's time counts from here
};

// Finds the frames of primitives, in O(log parts) each. The scene must outlive it and keep its
// parts. Thread-safe.
class ShownFrameTable {
 public:
  explicit ShownFrameTable(const Scene& scene);

  // Returns the frames at which primitive i can be shown.
  ShownFrames frames(std::size_t i) const;
  // Returns whether the support of primitive i, |t - T| <= r + sigma sqrt(ln(O / threshold)),
  // contains all of its frames().
  bool covers_clip(std::size_t i) const;

 private:
  const Scene& scene_;
  std::vector<std::uint64_t> ends_;  // of the primitives of each part
};

}  // namespace stgs
