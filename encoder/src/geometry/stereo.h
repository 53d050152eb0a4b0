// SPDX-License-Identifier: Apache-2.0
// Multi-view stereo of a rig: planes for the pixels of every view, confirmed by other views.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "geometry/stereo_problem.h"
#include "geometry/view_matcher.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// A grey image, 8 bits per pixel, with a pinhole camera: p_camera = rotation p_world + translation.
struct StereoView {
  int width = 0, height = 0;
  float fx = 0, fy = 0, cx = 0, cy = 0;  // pixels; pixel centres at +0.5
  Mat3 rotation{};
  Vec3 translation{};
  std::vector<std::uint8_t> grey;
  std::vector<int> sources;  // views to compare with, best first; at most kMaxSources are used
};

struct StereoSettings {
  float nearest = 0, farthest = 0;  // depth range, scene units
  int needed = 2;                   // other views that must confirm a plane
  std::uint64_t seed = 1;
};

// Returns StereoImage::corners of an image of width x height pixels.
std::vector<std::uint32_t> corners_of(const std::uint8_t* grey, int width, int height);

// The planes of a view, one per pixel.
struct StereoMap {
  std::vector<Hypothesis> planes;           // in the view's camera space
  std::vector<float> costs;                 // above 1 where no source sees the pixel
  std::vector<std::uint8_t> confirmations;  // other views that confirm it; 0: fewer than needed
};

// Runs task(i) for i in [0, count) in parallel. Returns the error of a task, or of cancelling.
using StereoLoop = std::function<Status(int count, const std::function<Status(int)>& task)>;

// Returns the maps of all views. A plane is confirmed by a view with a plane at the same depth,
// within 1 % and 1.5 pixels. Calls `loop` kStereoLoops times, unless it fails, and returns its
// errors.
inline constexpr int kStereoLoops = 6;
Result<std::vector<StereoMap>> match_views(const std::vector<StereoView>& views,
                                           const StereoSettings& settings, ViewMatcher& matcher,
                                           const StereoLoop& loop);

}  // namespace stgs::encoder::geometry
