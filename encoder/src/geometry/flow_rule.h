// SPDX-License-Identifier: Apache-2.0
// Dense optical flow by a search of patches, from coarse to fine, for the CPU and CUDA. It follows
// the method of Kroeger et al. (Fast Optical Flow using Dense Inverse Search, 2016), with patches
// that are independent of each other: each starts from the best of its own flow and its
// neighbours'. Flow is in pixels of its level; a level has half the width and height of the one
// before.
#pragma once

#include "stgs/format/math/lang.h"

namespace stgs::encoder::geometry {

using math::Vec2;

inline constexpr int kFlowPatch = 8;       // side of a patch, pixels
inline constexpr int kFlowStride = 4;      // between patches, pixels
inline constexpr int kFlowIterations = 8;  // of a search
inline constexpr int kFlowRounds = 3;      // searches per level
inline constexpr int kMaxFlowLevels = 12;
inline constexpr int kMinFlowSide = 32;  // of images whose flow is found, pixels
// Longer side of images up to which flow is found at full size, pixels; otherwise at a quarter.
inline constexpr int kFullFlowSide = 320;
// Added to the mean squared gradient of a patch, so that flat patches keep their flow.
inline constexpr float kFlatGradient = 0.25f;  // (grey levels per pixel)^2
inline constexpr float kLastFlowStep = 0.02f;  // that ends a search, pixels
// Largest forward-backward error of reliable flow, pixels, plus a fraction of its length.
inline constexpr float kRoundTrip = 0.75f, kRoundTripShare = 0.05f;

// A level of an image, with grey levels from 0 to 255 and their central differences.
struct FlowLevel {
  const float* grey;
  const Vec2* gradient;
  int width, height;
};

// The flow of a patch. The cost is the variance of the differences of its grey levels from those
// that it moves to.
struct PatchFlow {
  Vec2 flow;
  float cost;
};

STGS_FN int larger_int(int a, int b) {
  return a > b ? a : b;
}
STGS_FN int clamped_int(int x, int low, int high) {
  return x < low ? low : x > high ? high : x;
}

// Returns the coarsest level of an image: the last with 24 pixels along the longer side and a patch
// along the shorter.
STGS_FN int coarsest_flow_level(int width, int height) {
  const int longer = larger_int(width, height), shorter = width + height - longer;
  int level = 0;
  while ((longer >> (level + 1)) >= 24 && (shorter >> (level + 1)) >= kFlowPatch) ++level;
  return level;
}

// Returns the level at which flow is found and then interpolated.
STGS_FN int finest_flow_level(int width, int height) {
  const int wanted = larger_int(width, height) <= kFullFlowSide ? 0 : 2;
  const int coarsest = coarsest_flow_level(width, height);
  return wanted < coarsest ? wanted : coarsest;
}

// The number of patches along a side of a level, and where they start. The last is at the border.
STGS_FN int patches_along(int side) {
  return 1 + (side - kFlowPatch + kFlowStride - 1) / kFlowStride;
}
STGS_FN int patch_start(int i, int side) {
  const int at = kFlowStride * i, last = side - kFlowPatch;
  return at < last ? at : last;
}

// Returns pixel (x, y) of the next level.
STGS_FN float half_size_grey(const float* grey, int width, int x, int y) {
  const float* const row = grey + 2 * y * width + 2 * x;
  return 0.25f * (row[0] + row[1] + row[width] + row[width + 1]);
}

STGS_FN Vec2 grey_gradient(const float* grey, int width, int height, int x, int y) {
  const float* const row = grey + y * width;
  const float* const above = grey + (y > 0 ? y - 1 : 0) * width;
  const float* const below = grey + (y + 1 < height ? y + 1 : y) * width;
  const float left = row[x > 0 ? x - 1 : 0], right = row[x + 1 < width ? x + 1 : x];
  return math::vec2_of(0.5f * (right - left), 0.5f * (below[x] - above[x]));
}

// Returns a position in another image, in [-2^20, 2^20], as a whole number and a fraction.
STGS_FN int whole_of(float position, float* fraction) {
  const float bounded = math::clamped(position, -1048576.0f, 1048576.0f);
  const float whole = std::floor(bounded);
  *fraction = bounded - whole;
  return static_cast<int>(whole);
}

// The normal equations of a patch that starts at a pixel: the sums of the products of its
// gradients, less their means.
struct PatchSystem {
  Vec2 mean;         // of the gradients
  float xx, xy, yy;  // inverse of the sums
};

STGS_FN PatchSystem patch_system(const FlowLevel& from, int x0, int y0) {
  constexpr float kCount = static_cast<float>(kFlowPatch * kFlowPatch);
  float x = 0.0f, y = 0.0f, xx = 0.0f, xy = 0.0f, yy = 0.0f;
  for (int j = 0; j < kFlowPatch; ++j) {
    for (int i = 0; i < kFlowPatch; ++i) {
      const Vec2 g = from.gradient[(y0 + j) * from.width + x0 + i];
      x += g.x;
      y += g.y;
      xx += g.x * g.x;
      xy += g.x * g.y;
      yy += g.y * g.y;
    }
  }
  const Vec2 mean = math::vec2_of(x / kCount, y / kCount);
  xx += kCount * (kFlatGradient - mean.x * mean.x);
  xy -= kCount * mean.x * mean.y;
  yy += kCount * (kFlatGradient - mean.y * mean.y);
  const float unit = 1.0f / (xx * yy - xy * xy);
  return {mean, yy * unit, -xy * unit, xx * unit};
}

// The differences of a patch from where its flow leads: their sum, the sum of their squares, and
// the sums of their products with the gradients.
struct PatchSums {
  float sum, squares;
  Vec2 along;
};

STGS_FN PatchSums patch_sums(const FlowLevel& from, const float* to, int x0, int y0, Vec2 flow) {
  float fx = 0.0f, fy = 0.0f;
  const int left = whole_of(static_cast<float>(x0) + flow.x, &fx);
  const int top = whole_of(static_cast<float>(y0) + flow.y, &fy);
  const int last_x = from.width - 1, last_y = from.height - 1;
  PatchSums out{0.0f, 0.0f, {0.0f, 0.0f}};
  for (int j = 0; j < kFlowPatch; ++j) {
    const float* const a = to + clamped_int(top + j, 0, last_y) * from.width;
    const float* const b = to + clamped_int(top + j + 1, 0, last_y) * from.width;
    int at = clamped_int(left, 0, last_x);
    float before = a[at] + fy * (b[at] - a[at]);
    for (int i = 0; i < kFlowPatch; ++i) {
      at = clamped_int(left + i + 1, 0, last_x);
      const float after = a[at] + fy * (b[at] - a[at]);
      const int pixel = (y0 + j) * from.width + x0 + i;
      const float difference = before + fx * (after - before) - from.grey[pixel];
      const Vec2 g = from.gradient[pixel];
      out.sum += difference;
      out.squares += difference * difference;
      out.along.x += difference * g.x;
      out.along.y += difference * g.y;
      before = after;
    }
  }
  return out;
}

STGS_FN PatchFlow patch_flow_of(Vec2 flow, PatchSums sums) {
  constexpr float kUnit = 1.0f / static_cast<float>(kFlowPatch * kFlowPatch);
  const float mean = sums.sum * kUnit;
  return {flow, math::larger(sums.squares * kUnit - mean * mean, 0.0f)};
}

// Searches the flow of the patch that starts at pixel (x0, y0), by Gauss-Newton steps from `start`,
// until the cost no longer falls.
STGS_FN PatchFlow search_patch(const FlowLevel& from, const float* to, int x0, int y0, Vec2 start) {
  const PatchSystem system = patch_system(from, x0, y0);
  PatchSums sums = patch_sums(from, to, x0, y0, start);
  PatchFlow best = patch_flow_of(start, sums);
  for (int k = 0; k < kFlowIterations; ++k) {
    const float bx = sums.along.x - system.mean.x * sums.sum;
    const float by = sums.along.y - system.mean.y * sums.sum;
    const Vec2 step =
        math::vec2_of(system.xx * bx + system.xy * by, system.xy * bx + system.yy * by);
    const Vec2 next = math::vec2_of(best.flow.x - step.x, best.flow.y - step.y);
    const float dx = next.x - start.x, dy = next.y - start.y;
    if (!(dx * dx + dy * dy < static_cast<float>(kFlowPatch * kFlowPatch))) break;
    sums = patch_sums(from, to, x0, y0, next);
    const PatchFlow found = patch_flow_of(next, sums);
    if (!(found.cost < best.cost)) break;
    best = found;
    if (step.x * step.x + step.y * step.y < kLastFlowStep * kLastFlowStep) break;
  }
  return best;
}

// The flow of a level.
struct FlowField {
  const Vec2* flow;
  int width, height;
};

// Returns the flow at a position, in indices of pixels of its level, times `scale`; bilinear.
STGS_FN Vec2 flow_between(const FlowField& field, float x, float y, float scale) {
  x = math::clamped(x, 0.0f, static_cast<float>(field.width - 1));
  y = math::clamped(y, 0.0f, static_cast<float>(field.height - 1));
  const int left = static_cast<int>(x), top = static_cast<int>(y);
  const int right = clamped_int(left + 1, 0, field.width - 1);
  const int bottom = clamped_int(top + 1, 0, field.height - 1);
  const float fx = x - static_cast<float>(left), fy = y - static_cast<float>(top);
  const Vec2 a = field.flow[top * field.width + left], b = field.flow[top * field.width + right];
  const Vec2 c = field.flow[bottom * field.width + left];
  const Vec2 d = field.flow[bottom * field.width + right];
  const float u = (1.0f - fy) * (a.x + fx * (b.x - a.x)) + fy * (c.x + fx * (d.x - c.x));
  const float v = (1.0f - fy) * (a.y + fx * (b.y - a.y)) + fy * (c.y + fx * (d.y - c.y));
  return math::vec2_of(scale * u, scale * v);
}

// The patches of a level: columns x rows.
struct PatchGrid {
  const PatchFlow* patches;
  int columns, rows;
};

// The position itself, k = 0, and its four neighbours.
STGS_FN int beside_x(int k) {
  return k == 1 ? -1 : k == 2 ? 1 : 0;
}
STGS_FN int beside_y(int k) {
  return k == 3 ? -1 : k == 4 ? 1 : 0;
}

// Keeps the flow with the smaller cost.
STGS_FN void try_flow(const FlowLevel& from, const float* to, int x0, int y0, Vec2 flow,
                      PatchFlow* best) {
  const PatchFlow tried = patch_flow_of(flow, patch_sums(from, to, x0, y0, flow));
  if (tried.cost < best->cost) *best = tried;
}

inline constexpr float kNoFlowCost = 1e9f;  // larger than any

// Returns the flow of patch (i, j) of a level from that of the coarser level, which is empty for
// the coarsest.
STGS_FN PatchFlow first_patch_flow(const FlowLevel& from, const float* to, const FlowField& coarser,
                                   int i, int j) {
  const int x0 = patch_start(i, from.width), y0 = patch_start(j, from.height);
  if (coarser.flow == nullptr) return search_patch(from, to, x0, y0, math::vec2_of(0.0f, 0.0f));
  PatchFlow best{{0.0f, 0.0f}, kNoFlowCost};
  // The centre of the patch, and positions around it.
  const float x = 0.5f * static_cast<float>(x0) + 1.5f, y = 0.5f * static_cast<float>(y0) + 1.5f;
  for (int k = 0; k < 5; ++k) {
    const float u = x + static_cast<float>(kFlowStride * beside_x(k));
    const float v = y + static_cast<float>(kFlowStride * beside_y(k));
    try_flow(from, to, x0, y0, flow_between(coarser, u, v, 2.0f), &best);
  }
  return search_patch(from, to, x0, y0, best.flow);
}

// Returns the flow of patch (i, j) from those of its neighbours.
STGS_FN PatchFlow next_patch_flow(const FlowLevel& from, const float* to, const PatchGrid& grid,
                                  int i, int j) {
  const int x0 = patch_start(i, from.width), y0 = patch_start(j, from.height);
  const PatchFlow own = grid.patches[j * grid.columns + i];
  PatchFlow best = own;
  for (int k = 1; k < 5; ++k) {
    const int ni = i + beside_x(k), nj = j + beside_y(k);
    if (ni < 0 || nj < 0 || ni >= grid.columns || nj >= grid.rows) continue;
    try_flow(from, to, x0, y0, grid.patches[nj * grid.columns + ni].flow, &best);
  }
  return best.cost < own.cost ? search_patch(from, to, x0, y0, best.flow) : own;
}

// Returns the grey level to which a flow leads from pixel (x, y); bilinear.
STGS_FN float grey_after(const float* to, int width, int height, int x, int y, Vec2 flow) {
  float fx = 0.0f, fy = 0.0f;
  const int left = whole_of(static_cast<float>(x) + flow.x, &fx);
  const int top = whole_of(static_cast<float>(y) + flow.y, &fy);
  const float* const above = to + clamped_int(top, 0, height - 1) * width;
  const float* const below = to + clamped_int(top + 1, 0, height - 1) * width;
  const int l = clamped_int(left, 0, width - 1), r = clamped_int(left + 1, 0, width - 1);
  const float a = above[l] + fx * (above[r] - above[l]);
  const float b = below[l] + fx * (below[r] - below[l]);
  return a + fy * (b - a);
}

// Returns the flow of a pixel: the mean of those of the patches that cover it, each with the
// inverse of its difference there as weight, at most 1.
STGS_FN Vec2 dense_flow(const FlowLevel& from, const float* to, const PatchGrid& grid, int x,
                        int y) {
  float u = 0.0f, v = 0.0f, total = 0.0f;
  const int first_i = larger_int(0, (x - kFlowPatch + kFlowStride) / kFlowStride);
  const int first_j = larger_int(0, (y - kFlowPatch + kFlowStride) / kFlowStride);
  for (int j = first_j; j < grid.rows; ++j) {
    const int below = y - patch_start(j, from.height);
    if (below < 0) break;
    if (below >= kFlowPatch) continue;
    for (int i = first_i; i < grid.columns; ++i) {
      const int beside = x - patch_start(i, from.width);
      if (beside < 0) break;
      if (beside >= kFlowPatch) continue;
      const PatchFlow patch = grid.patches[j * grid.columns + i];
      const float grey = grey_after(to, from.width, from.height, x, y, patch.flow);
      const float difference = std::abs(grey - from.grey[y * from.width + x]);
      const float weight = 1.0f / math::larger(1.0f, difference);
      u += weight * patch.flow.x;
      v += weight * patch.flow.y;
      total += weight;
    }
  }
  return math::vec2_of(u / total, v / total);
}

// Returns the flow of pixel (x, y) of the image from that of a level.
STGS_FN Vec2 image_flow(const FlowField& field, int level, int x, int y) {
  const float scale = static_cast<float>(1 << level), unit = 1.0f / scale;
  return flow_between(field, (static_cast<float>(x) + 0.5f) * unit - 0.5f,
                      (static_cast<float>(y) + 0.5f) * unit - 0.5f, scale);
}

STGS_FN float flow_length(Vec2 flow) {
  return std::sqrt(flow.x * flow.x + flow.y * flow.y);
}

// Returns the flow of pixel (x, y) of an image, NaN where the flow back disagrees.
STGS_FN Vec2 checked_flow(const FlowField& forward, const FlowField& back, int level, int width,
                          int height, int x, int y) {
  const Vec2 f = image_flow(forward, level, x, y);
  const float tx = std::floor(static_cast<float>(x) + f.x + 0.5f);
  const float ty = std::floor(static_cast<float>(y) + f.y + 0.5f);
  const bool is_inside =
      tx >= 0.0f && ty >= 0.0f && tx < static_cast<float>(width) && ty < static_cast<float>(height);
  if (is_inside) {
    const Vec2 r = image_flow(back, level, static_cast<int>(tx), static_cast<int>(ty));
    const float error = flow_length(math::vec2_of(f.x + r.x, f.y + r.y));
    if (error < kRoundTrip + kRoundTripShare * flow_length(f)) return f;
  }
  return math::vec2_of(NAN, NAN);
}

}  // namespace stgs::encoder::geometry
