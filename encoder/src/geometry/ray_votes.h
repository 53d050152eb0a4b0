// SPDX-License-Identifier: Apache-2.0
// Votes of views about points of a ray, with vectors over the points.
#pragma once

#include <vector>

namespace stgs::encoder::geometry {

// A view of the dynamic content. `hiding`: the depth behind which each pixel sees nothing, scene
// units, negative if the pixel shows dynamic content.
struct VotingView {
  const float* hiding;  // width x height
  int width, height;
  float fx, fy, cx, cy;      // pixels
  float start[3], along[3];  // the ray in the space of the camera
};

// The number of views that see each point as dynamic content, and of those that see it otherwise.
struct RayVotes {
  std::vector<float> inside, outside;
};

// Adds the votes of a view about the points start + depths[k] * along. Points nearer than
// `nearest`, which is above 0, are not visible.
void add_votes(const VotingView& view, const std::vector<float>& depths, float nearest,
               RayVotes* votes);

}  // namespace stgs::encoder::geometry
