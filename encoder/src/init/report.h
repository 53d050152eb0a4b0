// SPDX-License-Identifier: Apache-2.0
// Writes report/ of a prepared capture: an HTML page with images for visual inspection.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "init/findings.h"
#include "init/motion.h"
#include "init/static_points.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

struct ReportFacts {
  std::vector<Finding> findings;
  std::vector<std::pair<std::string, std::string>> lines;  // name, value
  std::vector<StageTime> stages;
};

// References to the results that a report shows.
struct ReportContents {
  const PreparedCapture& capture;
  const std::vector<View>& views;
  const StaticScene& scene;
  const std::vector<ViewMotion>& motion;
  const std::vector<InitialPoint>&static_points, &dynamic_points;
};

// Writes report/index.html and its images: a verdict, a map of the cameras, mask overlays, static
// points and depth, dynamic points with their velocities.
Status write_report(const ReportContents& contents, const ReportFacts& facts, Work& work);

}  // namespace stgs::encoder::init
