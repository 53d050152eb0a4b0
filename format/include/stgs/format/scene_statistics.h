// SPDX-License-Identifier: Apache-2.0
// How long the primitives of a scene live and how fast they move.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// A primitive that covers the clip is static where it moves by at most this share of the scene's
// radius over the clip: about half a pixel for a camera one radius away whose focal length is 500.
inline constexpr double kStaticShare = 1e-3;

// Values in [from, to).
struct HistogramBin {
  double from = 0;
  double to = std::numeric_limits<double>::infinity();
  std::uint64_t count = 0;
};

struct SceneStatistics {
  std::uint64_t primitives = 0;
  std::uint64_t never_visible = 0;  // O below the threshold 1/255: in no count below
  double clip_seconds = 0;          // frames x tick
  // Of the primitives' positions: distance from their median within which 95 % of them lie.
  double scene_radius = 0;  // scene units

  // Support length 2 (r + sigma sqrt(ln(O / threshold))), seconds; each edge doubles the one before
  // and one is the clip's length. Primitives whose support covers every frame are in whole_clip.
  std::vector<HistogramBin> lifespans;
  std::uint64_t whole_clip = 0;
  double median_lifespan = 0;  // seconds, of all

  // Effective speed |u|, scene units a second; two bins a decade.
  std::vector<HistogramBin> speeds;
  double median_speed = 0;

  double static_bound = 0;              // scene units over the clip: kStaticShare scene_radius
  std::uint64_t static_primitives = 0;  // cover the clip and move by no more than that
  double whole_clip_drift = 0;  // scene units over the clip, mean of those that cover it; 0: none

  // Of the visible primitives; 0 where there are none.
  double static_share() const;
};

SceneStatistics scene_statistics(const Scene& scene);

// The first and the last frame at which primitive i is drawn where its support has them, ticks: the
// clip's, or its part's in a scene in parts, for which these stand in for the clip.
struct ShownFrames {
  double first = 0, last = 0;
  double part_begin = 0;  // from which the primitive's time counts
};
ShownFrames shown_frames(const Scene& scene, std::size_t i);

// Whether the support of primitive i, |t - T| <= r + sigma sqrt(ln(O / threshold)), holds all
// of its shown_frames.
bool covers_clip(const Scene& scene, std::size_t i);

}  // namespace stgs
