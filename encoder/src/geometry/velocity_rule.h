// SPDX-License-Identifier: Apache-2.0
// How velocities follow from the points of two frames, for the CPU and CUDA. The steps of one frame
// are found in rounds:
//   1. Each point, moved by its step of the last round, is matched: its new step is the mean of
//      those to the nearest kMatchedPoints of the other frame that are within reach.
//   2. Each step is replaced by the median, per component, of the known steps of the nearest points
//      of the same frame that are within reach.
// Distances are of positions and weighted colours.
#pragma once

#include "stgs/format/math/lang.h"

namespace stgs::encoder::geometry {

inline constexpr int kMatchRounds = 6;
inline constexpr int kMatchedPoints = 3;
// Neighbours that smooth, with the point itself: in all rounds and the last.
inline constexpr int kWideNeighbours = 25, kNarrowNeighbours = 9;
inline constexpr int kMinForMedian = 3;  // known steps; with fewer the step is unknown
// Distance between channels of colour 0 and 255, in units of the reach.
inline constexpr double kMatchColour = 2, kSmoothColour = 0.2;

// Returns the number of neighbours that smooth in a round.
STGS_FN int smoothing_neighbours(int round) {
  return round + 1 < kMatchRounds ? kWideNeighbours : kNarrowNeighbours;
}

// Returns the median of 1 to kWideNeighbours values, of an even number the larger of the two in the
// middle. Sorts the values.
template <typename T>
STGS_FN T median_of(T* values, int count) {
  for (int i = 1; i < count; ++i) {
    const T value = values[i];
    int k = i;
    for (; k > 0 && value < values[k - 1]; --k) values[k] = values[k - 1];
    values[k] = value;
  }
  return values[count / 2];
}

// A point of a frame. The position is in scene units, from an origin near all points, because of
// the precision; colours are from 0 to 255.
struct STGS_ALIGNED(8) MatchPoint {
  float x, y, z, red, green, blue;
};

// Returns the squared distance of points; `colour`: the squared weight of colours.
STGS_FN float squared_distance(MatchPoint a, MatchPoint b, float colour) {
  const float x = a.x - b.x, y = a.y - b.y, z = a.z - b.z;
  const float red = a.red - b.red, green = a.green - b.green, blue = a.blue - b.blue;
  return x * x + y * y + z * z + colour * (red * red + green * green + blue * blue);
}

// The nearest kCount points, nearest first; of equal distances the point that was added first.
template <int kCount>
struct NearestPoints {
  float squared[kCount];  // distances
  int index[kCount];      // -1: fewer points were added
};

template <int kCount>
STGS_FN NearestPoints<kCount> no_points() {
  NearestPoints<kCount> out;
  for (int k = 0; k < kCount; ++k) {
    out.squared[k] = 3e38f;
    out.index[k] = -1;
  }
  return out;
}

// Loops have constant bounds and no early end, so that the compiler keeps the arrays in registers.
template <int kCount>
STGS_FN void add_point(NearestPoints<kCount>& nearest, float squared, int index) {
  if (!(squared < nearest.squared[kCount - 1])) return;
#if defined(__CUDA_ARCH__)
#pragma unroll
#endif
  for (int k = kCount - 1; k > 0; --k) {
    const bool moves = squared < nearest.squared[k - 1];
    const bool fits = squared < nearest.squared[k];
    nearest.index[k] = moves ? nearest.index[k - 1] : fits ? index : nearest.index[k];
    nearest.squared[k] = moves ? nearest.squared[k - 1] : fits ? squared : nearest.squared[k];
  }
  if (squared < nearest.squared[0]) {
    nearest.squared[0] = squared;
    nearest.index[0] = index;
  }
}

}  // namespace stgs::encoder::geometry
