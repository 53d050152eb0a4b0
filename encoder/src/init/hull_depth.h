// SPDX-License-Identifier: Apache-2.0
// Depth maps of the dynamic content of one frame: plane sweeps confined to the visual hull, on the
// CPU or on a GPU.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "geometry/hull_sweep.h"
#include "init/depth_sweep.h"
#include "init/hull.h"
#include "init/work.h"

namespace stgs::encoder::init {

// The visual hull of a frame.
struct DynamicHull {
  std::vector<Silhouette> silhouettes;
  DepthInterval limits;  // nothing is nearer to a view, and nothing is sought farther away
};

// A view whose depth is wanted inside a mask (8-bit), against its partners.
struct HullView {
  int view = 0;
  cv::Mat mask;
  std::vector<int> partners;
};

// The depth of a view inside its mask. Empty maps: it has too few masked pixels or no partner.
struct SweptView {
  DepthMap map;
  double step = 0;  // largest step in inverse depth between planes
  cv::Mat mask;
};

// Sweeps the views. `images`: of all views, without an image where none is needed. `gpu`: null for
// the CPU. Checks `work` for cancellation. Thread-safe.
Status sweep_hull(const std::vector<SweepImage>& images, const std::vector<HullView>& wanted,
                  const DynamicHull& hull, geometry::HullSweeper* gpu, const Work& work,
                  std::vector<SweptView>* out);

}  // namespace stgs::encoder::init
