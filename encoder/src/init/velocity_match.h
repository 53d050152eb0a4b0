// SPDX-License-Identifier: Apache-2.0
// Velocities from the nearest neighbours of points in another frame (the method of the paper), on
// the CPU or on a GPU (geometry/velocity_rule.h).
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "geometry/velocity_matcher.h"
#include "init/dynamic_points.h"
#include "init/motion_fit.h"
#include "init/work.h"

namespace stgs::encoder::init {

inline const cv::Vec3d kUnknown = cv::Vec3d::all(std::numeric_limits<double>::quiet_NaN());

inline bool known(const cv::Vec3d& v) {
  return v[0] == v[0];
}

// Returns `first` with unknown velocities taken from `second`, or 0 if both are unknown.
Velocities fill_unknown(const Velocities& first, const Velocities& second);

// Smooths velocities of points among their nearest neighbours.
class Smoother {
 public:
  // `count`: neighbours of a point; those farther than `reach` do not count.
  Smoother(const std::vector<SurfacePoint>& points, double reach, std::size_t count);

  // Replaces each velocity by the median of the known velocities of the `count` nearest points, or
  // by kUnknown if there are fewer than geometry::kMinForMedian.
  Velocities smoothed(const Velocities& raw, std::size_t count) const;

 private:
  struct Neighbours {
    std::vector<std::uint32_t> index;
    std::vector<double> squared;  // distances
  };
  cv::Vec3d smoothed_at(std::size_t i, const Velocities& raw, std::size_t count) const;

  double reach_;
  std::vector<Neighbours> neighbours_;  // nearest first
};

// Returns the displacement to the nearest points of `next` in position and colour, smoothed by the
// median over neighbouring points. Unknown where nothing matches within `reach` scene units. On the
// CPU.
Velocities match_velocities(const std::vector<SurfacePoint>& points,
                            const std::vector<SurfacePoint>& next, double reach);

// A frame with points and the frame that they are matched with.
struct FrameMatch {
  int from = 0, to = 0;
  double per_frame = 1;  // velocity (scene units per frame) of a step of one scene unit
};

// Returns the pairs of a frame and the one that is `interval` frames later, or earlier at the end.
// Both have points.
std::vector<FrameMatch> matches_of(const std::vector<DynamicFrame>& frames, int interval);

// Sets the velocities of the points of all frames, 0 where they are unknown, from the frames that
// they are matched with. `reach`: scene units per frame. `gpu`: null for the CPU, and from
// gpu_within_limits(). One pass of a stage of `work`, which is checked for cancellation.
Status match_frames(const std::vector<DynamicFrame>& frames, int interval, double reach,
                    geometry::VelocityMatcher* gpu, Work& work, std::vector<Velocities>* out);

}  // namespace stgs::encoder::init
