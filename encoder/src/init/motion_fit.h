// SPDX-License-Identifier: Apache-2.0
// Measures how well velocities of dynamic points agree with the next frame.
#pragma once

#include <span>
#include <vector>

#include "init/cover.h"
#include "init/view.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/status.h"

namespace stgs::encoder::init {

using Velocities = std::vector<cv::Vec3d>;  // per point, scene units per frame; NaN: unknown

// The depth of the nearest point in each coarse cell of a view, which hides those behind it.
class Fronts {
 public:
  Fronts(const View& view, const std::vector<SurfacePoint>& points);
  // Returns whether a nearer point hides a pixel, which is inside the view.
  bool hides(const Pixel& pixel) const;

 private:
  cv::Mat depth_;
};

// Agreement of moved points with the next frame. Sums over projections.
struct MotionFit {
  long samples = 0, inside = 0;  // projections, and those inside the masks of the next frame
  double difference = 0;         // of colours: mean absolute difference of channels, grey levels

  // Returns the mean residual in grey levels. A projection outside the masks counts as 64 levels.
  double residual() const;
  void operator+=(const MotionFit& other);
};

// Projects the points, moved by each of the estimates of their velocities, which are known, into
// the frame `next_frame` of all views. Returns a fit per estimate. On all threads.
Result<std::vector<MotionFit>> measure_motion(const PreparedCapture& capture,
                                              const std::vector<View>& views,
                                              const std::vector<SurfacePoint>& points,
                                              std::span<const Velocities> estimates,
                                              int next_frame);

}  // namespace stgs::encoder::init
