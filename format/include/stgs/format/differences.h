// SPDX-License-Identifier: Apache-2.0
// The error of a coded primitive, over the duration of its part.
#pragma once

#include <cstddef>

#include "stgs/format/scene_file.h"

namespace stgs {

// Returns the greatest distance, in scene units, between primitive i of `a` and primitive j of `b`
// while that of `a` is visible within its part, which lasts `part_ticks`; 0 if it never is.
double trajectory_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
                        double part_ticks);

// Differences between two lifespans; all 0 if the primitive of `a` is never visible.
struct LifespanError {
  // Greatest difference of O l(t), 0..1, at the frames of the timeline. Slow changes over many
  // frames are sampled at 64 of them.
  double visibility = 0;
  // Differences of the parameters, all 0 if that of `b` is fully visible throughout its part. T and
  // r, in ticks, exclude the invisible share of a flat top beyond the time of the part that is
  // nearest to T. Sigma: natural log.
  double time = 0, radius = 0, sigma = 0;
};
// Compares the lifespans of primitive i of `a` and primitive j of `b`. `part` is the range of their
// part in ticks of the timeline; their T counts from its beginning.
LifespanError lifespan_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                             std::size_t j, const TickRange& part);

// Calls visit(i, part) for each primitive of a scene, in order. `part`: a TickRange.
template <typename Visit>
void for_each_in_part(const Scene& scene, const Visit& visit) {
  std::size_t i = 0;
  if (scene.parts.empty()) {
    const TickRange all{0.0, static_cast<double>(scene.metadata.frames)};
    for (; i < scene.gaussians.size(); ++i) visit(i, all);
  }
  for (const ScenePart& part : scene.parts) {
    const TickRange range{part.begin_ticks, part.end_ticks};
    for (const std::size_t last = i + part.primitives; i < last; ++i) visit(i, range);
  }
}

}  // namespace stgs
