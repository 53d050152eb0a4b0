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

// The most hypotheses that are considered at once: those of propagate() or of refine().
inline constexpr int kMaxCandidates = 8;

STGS_FN std::size_t pixel_index(const StereoProblem& problem, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(problem.reference.width) +
         static_cast<std::size_t>(x);
}

// Returns a plane with uniform inverse depth and orientation.
STGS_FN Hypothesis random_plane(const StereoProblem& problem, float u, float v, Random& random) {
  const float near = 1.0f / problem.nearest, far = 1.0f / problem.farthest;
  Hypothesis plane;
  plane.depth = 1.0f / (far + (near - far) * random.uniform());
  const float x = random.normal(), y = random.normal(), z = random.normal();
  plane.normal = facing(problem.reference, u, v, math::vec3_of(x, y, z));
  return plane;
}

// The cheapest hypothesis considered so far; the first one of equal cost.
struct Search {
  const StereoProblem& problem;
  const Support& support;
  int x, y;
  Hypothesis best{0.0f, {0.0f, 0.0f, -1.0f}};
  float cost = 1e9f;

  STGS_FN void consider(Hypothesis plane) {
    if (!(plane.depth > 0.0f)) return;
    const float c = hypothesis_cost(problem, support, x, y, plane);
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

// Considers the cheapest plane of each of eight areas: V shapes next to pixel (x, y), and, with
// `strips`, strips along the axes. They hold only pixels of the other colour.
template <typename Candidates>
STGS_FN void propagate(const StereoProblem& problem, const PlaneMap& map, int x, int y, bool strips,
                       Candidates& candidates) {
  constexpr int kStrip = 8;  // pixels
  const int width = problem.reference.width, height = problem.reference.height;
  for (int area = 0; area < 8; area += strips ? 1 : 2) {
    const int direction = area / 2, ax = (direction == 2) - (direction == 3);
    const int ay = (direction == 0) - (direction == 1), bx = ay != 0, by = ax != 0;
    Lowest lowest{map, width, height};
    if (area % 2 == 0) {
      lowest.look(x + ax, y + ay);
      for (int k = 1; k <= 2; ++k) {
        lowest.look(x + (k + 1) * ax + k * bx, y + (k + 1) * ay + k * by);
        lowest.look(x + (k + 1) * ax - k * bx, y + (k + 1) * ay - k * by);
      }
    } else {
      for (int k = 1; k <= kStrip; ++k) lowest.look(x + (2 * k + 1) * ax, y + (2 * k + 1) * ay);
    }
    if (lowest.x < 0) continue;
    const std::size_t at = static_cast<std::size_t>(lowest.y) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(lowest.x);
    candidates.consider(moved_plane(problem, map.planes[at], static_cast<float>(lowest.x) + 0.5f,
                                    static_cast<float>(lowest.y) + 0.5f,
                                    static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f));
  }
}

// Random changes of a plane.
struct Changes {
  float shifted, stretched;  // depths
  Vec3 tilted;               // normal
};

// Returns changes of a plane of image position (u, v) that shrink with the iterations.
STGS_FN Changes changes_of(const StereoProblem& problem, float u, float v, Hypothesis plane,
                           int iteration, Random& random) {
  const float reach = std::exp2(-static_cast<float>(iteration));
  const float near = 1.0f / problem.nearest, far = 1.0f / problem.farthest;
  const float shift = 0.25f * reach * (near - far) * (2.0f * random.uniform() - 1.0f);
  const float stretch = 1.0f + 0.02f * reach * (2.0f * random.uniform() - 1.0f);
  const float stretched = math::clamped(plane.depth * stretch, problem.nearest, problem.farthest);
  const float tx = random.normal(), ty = random.normal(), tz = random.normal();
  const Vec3 tilt = math::vec3_scale(math::vec3_of(tx, ty, tz), 0.5f * reach);
  const float shifted = 1.0f / math::clamped(1.0f / plane.depth + shift, far, near);
  return {shifted, stretched, facing(problem.reference, u, v, math::vec3_add(plane.normal, tilt))};
}

// Considers a random plane of pixel (x, y), and changes of a given one.
template <typename Candidates>
STGS_FN void vary(const StereoProblem& problem, int x, int y, Hypothesis plane, int iteration,
                  Random random, Candidates& candidates) {
  const float u = static_cast<float>(x) + 0.5f, v = static_cast<float>(y) + 0.5f;
  const Hypothesis drawn = random_plane(problem, u, v, random);
  const Changes to = changes_of(problem, u, v, plane, iteration, random);
  candidates.consider(drawn);
  candidates.consider({plane.depth, drawn.normal});
  candidates.consider({to.shifted, plane.normal});
  candidates.consider({to.stretched, plane.normal});
  candidates.consider({plane.depth, to.tilted});
  candidates.consider({to.stretched, to.tilted});
}

// Whether a pass refines planes of an earlier one. It considers half as many hypotheses.
STGS_FN bool is_refining(const StereoProblem& problem) {
  return problem.consistency > 0.0f;
}

// Considers the plane of pixel (x, y), those next to it, and changes of its own.
template <typename Candidates>
STGS_FN void refine(const StereoProblem& problem, const PlaneMap& map, int x, int y, int iteration,
                    Random random, Candidates& candidates) {
  const Hypothesis own = map.planes[pixel_index(problem, x, y)];
  const Changes to = changes_of(problem, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f,
                                own, iteration, random);
  candidates.consider(own);
  propagate(problem, map, x, y, false, candidates);
  candidates.consider({to.shifted, own.normal});
  candidates.consider({own.depth, to.tilted});
  candidates.consider({to.stretched, to.tilted});
}

// Considers random planes of pixel (x, y).
template <typename Candidates>
STGS_FN void draw(const StereoProblem& problem, int x, int y, Random random,
                  Candidates& candidates) {
  for (int k = 0; k < kMaxCandidates; ++k)
    candidates.consider(
        random_plane(problem, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, random));
}

STGS_FN Random random_of(std::uint64_t seed, std::size_t pixel) {
  return Random(seed, pixel, RandomPurpose::kStereo);
}

// The updates of pixel (x, y), one hypothesis at a time: the reference for the vectorised version
// (stereo_rows.h), and the text of the CUDA kernels.

// Gives the pixel the cheapest of some random planes.
STGS_FN void start_pixel(const StereoProblem& problem, const PlaneMap& map, int x, int y,
                         std::uint64_t seed) {
  const std::size_t at = pixel_index(problem, x, y);
  Support support;
  load_support(problem.reference, x, y, &support);
  Search search{problem, support, x, y};
  draw(problem, x, y, random_of(seed, at), search);
  map.planes[at] = search.best;
  map.costs[at] = search.cost;
}

// Improves the plane of the pixel, while pixels of the other colour (parity of x + y) do not
// change. The costs of the map may be of an earlier pass; that of the pixel is computed again.
STGS_FN void update_pixel(const StereoProblem& problem, const PlaneMap& map, int x, int y,
                          int iteration, std::uint64_t seed) {
  const std::size_t at = pixel_index(problem, x, y);
  Support support;
  load_support(problem.reference, x, y, &support);
  Search search{problem, support, x, y};
  const Random random = random_of(seed + static_cast<std::uint64_t>(iteration) + 1, at);
  if (is_refining(problem)) {
    refine(problem, map, x, y, iteration, random, search);
  } else {
    propagate(problem, map, x, y, true, search);
    const Hypothesis own = map.planes[at];
    const Hypothesis base = map.costs[at] <= search.cost ? own : search.best;
    search.consider(own);
    vary(problem, x, y, base, iteration, random, search);
  }
  map.planes[at] = search.best;
  map.costs[at] = search.cost;
}

}  // namespace stgs::encoder::geometry
