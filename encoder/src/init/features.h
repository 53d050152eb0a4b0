// SPDX-License-Identifier: Apache-2.0
// Triangulates features with COLMAP, in parallel with other stages. COLMAP is optional: without it
// the initial points are only less accurate.
#pragma once

#include <atomic>
#include <future>
#include <vector>

#include "init/static_points.h"
#include "init/work.h"

namespace stgs::encoder::init {

class FeatureSearch {
 public:
  FeatureSearch() = default;
  // Stops COLMAP and waits for it.
  ~FeatureSearch() { abandoned_ = true; }
  FeatureSearch(const FeatureSearch&) = delete;
  FeatureSearch& operator=(const FeatureSearch&) = delete;

  // Starts on frame 0; without the masked pixels, if motion is separated. The arguments must
  // outlive the object. Does nothing for fewer than two views; logs if COLMAP is not installed.
  void start(const PreparedCapture& capture, const std::vector<View>& views, bool separate_motion,
             const Work& work);
  // Waits for the points, in the stage "features", and returns those within the depth range of a
  // view; none if the search was not started or failed. kRuntime if cancelled.
  Result<std::vector<SurfacePoint>> points(const std::vector<View>& views, const DepthRange& range,
                                           Work& work);

 private:
  std::atomic<bool> abandoned_{false};
  std::future<Result<std::vector<SurfacePoint>>> search_;  // its destructor joins the thread
};

}  // namespace stgs::encoder::init
