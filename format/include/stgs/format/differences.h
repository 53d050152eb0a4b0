// SPDX-License-Identifier: Apache-2.0
// How far a primitive that was coded is from what it was, over the moments of its part.
#pragma once

#include <cstddef>

#include "stgs/format/scene_file.h"

namespace stgs {

// How far apart primitive i of `a` and j of `b` lie at most, scene units, at the moments of their
// part, which lasts `part_ticks`, at which that of `a` is seen; 0 where it never is.
double trajectory_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
                        double part_ticks);

// Of when and how much they are seen; 0 where that of `a` never is.
struct LifespanError {
  // Greatest difference of O l(t) at a frame of the timeline, 0..1. Where it changes slowly over
  // many frames, 64 of them stand for all.
  double visibility = 0;
  // Of the numbers themselves, unless that of `b` is seen alike throughout its part: T and r,
  // ticks, without what of a flat top lies beyond T's nearest moment of the part, which nobody
  // sees; and sigma, natural log.
  double time = 0, radius = 0, sigma = 0;
};
// `part`: ticks of the timeline, from which T counts in it.
LifespanError lifespan_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                             std::size_t j, const TickRange& part);

// visit(i, part) for each primitive of a scene, in order.
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
