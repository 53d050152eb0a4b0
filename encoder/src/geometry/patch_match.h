// SPDX-License-Identifier: Apache-2.0
// PatchMatch stereo with slanted supports, after Bleyer, Rhemann and Rother (BMVC 2011), with the
// red-black order of Galliani, Lasinger and Schindler (ICCV 2015) and candidates from areas around
// a pixel, after Xu and Tao (CVPR 2019). Shared by the CPU and CUDA.
#pragma once

#include "geometry/support_cost.h"
#include "train/random.h"

namespace stgs::encoder::geometry {

// The hypotheses of a reference and their costs, width x height.
struct PlaneMap {
  Hypothesis* planes;
  float* costs;
};

// Returns a plane with uniform inverse depth and orientation.
STGS_FN Hypothesis random_plane(const StereoProblem& problem, float u, float v, Random& random) {
  const float near = 1.0f / problem.nearest, far = 1.0f / problem.farthest;
  Hypothesis plane;
  plane.depth = 1.0f / (far + (near - far) * random.uniform());
  const float x = random.normal(), y = random.normal(), z = random.normal();
  plane.normal = facing(problem.reference, u, v, math::vec3_of(x, y, z));
  return plane;
}

// The cheapest known hypothesis of a pixel.
template <typename Sums>
struct Search {
  const StereoProblem& problem;
  const Support& support;
  const Sums& sums_of;
  int x, y;
  Hypothesis best;
  float cost;

  STGS_FN void consider(Hypothesis plane) {
    if (!(plane.depth > 0.0f)) return;
    const float c = hypothesis_cost(problem, support, x, y, plane, sums_of);
    if (!(c < cost)) return;
    cost = c;
    best = plane;
  }
};

// The pixel of lowest cost so far in an area around another.
struct Lowest {
  const PlaneMap& map;
  int width, height;
  float cost = 1e9f;
  int x = -1, y = -1;

  STGS_FN void look(int px, int py) {
    if (px < 0 || py < 0 || px >= width || py >= height) return;
    const float c = map.costs[static_cast<std::size_t>(py) * static_cast<std::size_t>(width) +
                              static_cast<std::size_t>(px)];
    if (!(c < cost)) return;
    cost = c;
    x = px;
    y = py;
  }
};

// Considers the cheapest plane of each of eight areas: V shapes next to the pixel, then strips
// along the axes. They hold only pixels of the other colour.
template <typename Sums>
STGS_FN void propagate(const PlaneMap& map, Search<Sums>& search) {
  constexpr int kStrip = 8;  // pixels
  const int width = search.problem.reference.width, height = search.problem.reference.height;
  for (int area = 0; area < 8; ++area) {
    const int direction = area / 2, ax = (direction == 2) - (direction == 3);
    const int ay = (direction == 0) - (direction == 1), bx = ay != 0, by = ax != 0;
    Lowest lowest{map, width, height};
    if (area % 2 == 0) {
      lowest.look(search.x + ax, search.y + ay);
      for (int k = 1; k <= 2; ++k) {
        lowest.look(search.x + (k + 1) * ax + k * bx, search.y + (k + 1) * ay + k * by);
        lowest.look(search.x + (k + 1) * ax - k * bx, search.y + (k + 1) * ay - k * by);
      }
    } else {
      for (int k = 1; k <= kStrip; ++k)
        lowest.look(search.x + (2 * k + 1) * ax, search.y + (2 * k + 1) * ay);
    }
    if (lowest.x < 0) continue;
    const std::size_t at = static_cast<std::size_t>(lowest.y) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(lowest.x);
    search.consider(moved_plane(search.problem, map.planes[at], static_cast<float>(lowest.x) + 0.5f,
                                static_cast<float>(lowest.y) + 0.5f,
                                static_cast<float>(search.x) + 0.5f,
                                static_cast<float>(search.y) + 0.5f));
  }
}

// Considers a random plane, and changes of the best one that shrink with the iterations.
template <typename Sums>
STGS_FN void perturb(int iteration, Random random, Search<Sums>& search) {
  const StereoProblem& problem = search.problem;
  const float u = static_cast<float>(search.x) + 0.5f, v = static_cast<float>(search.y) + 0.5f;
  const float reach = std::exp2(-static_cast<float>(iteration));
  const Hypothesis best = search.best, drawn = random_plane(problem, u, v, random);
  const float near = 1.0f / problem.nearest, far = 1.0f / problem.farthest;
  const float shift = 0.25f * reach * (near - far) * (2.0f * random.uniform() - 1.0f);
  const float stretch = 1.0f + 0.02f * reach * (2.0f * random.uniform() - 1.0f);
  const float stretched = math::clamped(best.depth * stretch, problem.nearest, problem.farthest);
  const float x = random.normal(), y = random.normal(), z = random.normal();
  const Vec3 tilt = math::vec3_scale(math::vec3_of(x, y, z), 0.5f * reach);
  const Vec3 tilted = facing(problem.reference, u, v, math::vec3_add(best.normal, tilt));
  const float shifted = 1.0f / math::clamped(1.0f / best.depth + shift, far, near);
  search.consider(drawn);
  search.consider({best.depth, drawn.normal});
  search.consider({shifted, best.normal});
  search.consider({stretched, best.normal});
  search.consider({best.depth, tilted});
  search.consider({stretched, tilted});
}

STGS_FN std::size_t pixel_index(const StereoProblem& problem, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(problem.reference.width) +
         static_cast<std::size_t>(x);
}

// Gives pixel (x, y) a random plane, unless it has one, and computes its cost.
template <typename Sums>
STGS_FN void start_pixel(const StereoProblem& problem, const PlaneMap& map, int x, int y,
                         std::uint64_t seed, const Sums& sums_of) {
  const std::size_t at = pixel_index(problem, x, y);
  if (!(map.planes[at].depth > 0.0f)) {
    Random random(seed, at, RandomPurpose::kStereo);
    map.planes[at] =
        random_plane(problem, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, random);
  }
  Support support;
  sums_of.load(problem.reference, x, y, &support);
  map.costs[at] = hypothesis_cost(problem, support, x, y, map.planes[at], sums_of);
}

// Improves the plane of pixel (x, y), while pixels of the other colour (parity of x + y) do not
// change. `iteration` counts from 0 in a pass.
template <typename Sums>
STGS_FN void update_pixel(const StereoProblem& problem, const PlaneMap& map, int x, int y,
                          int iteration, std::uint64_t seed, const Sums& sums_of) {
  const std::size_t at = pixel_index(problem, x, y);
  Support support;
  sums_of.load(problem.reference, x, y, &support);
  Search<Sums> search{problem, support, sums_of, x, y, map.planes[at], map.costs[at]};
  propagate(map, search);
  const Random random(seed + static_cast<std::uint64_t>(iteration) + 1, at, RandomPurpose::kStereo);
  perturb(iteration, random, search);
  map.planes[at] = search.best;
  map.costs[at] = search.cost;
}

}  // namespace stgs::encoder::geometry
