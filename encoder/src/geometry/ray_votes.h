// SPDX-License-Identifier: Apache-2.0
// Votes of views about points of a ray, with vectors over the points.
#pragma once

#include <cstddef>
#include <vector>

namespace stgs::encoder::geometry {

// A view of the dynamic content. `hiding`: each pixel sees nothing beyond this depth, scene units;
// negative if the pixel shows dynamic content.
struct VotingView {
  const float* hiding;  // width x height
  int width, height;
  float fx, fy, cx, cy;      // pixels
  float start[3], along[3];  // the ray in the space of the camera
};

// The votes about the points start + depths[k] * along. The arrays are padded to whole vectors.
struct RayVotes {
  std::size_t count = 0;                       // of points
  std::vector<float> depths, inside, outside;  // votes for dynamic content, and for other content

  explicit RayVotes(const std::vector<float>& points);
  // Retains the first `points` points.
  void resize(std::size_t points);
};

// Adds the votes of a view. A point nearer than `nearest`, which is above 0, is not visible, and
// neither is one outside of the image. Thread-safe for different votes.
void add_votes(const VotingView& view, float nearest, RayVotes* votes);

}  // namespace stgs::encoder::geometry
