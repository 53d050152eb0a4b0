// SPDX-License-Identifier: Apache-2.0
// The findings in the first window of a long capture that later windows use, in memory and in a
// file.
#pragma once

#include <string>
#include <vector>

#include "init/static_points.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct StaticFindings {
  std::vector<std::string> agreeing;  // names of the cameras that points come from, in order
  init::DepthRange range;
  init::Focus focus;
  std::vector<init::Surface> surfaces;  // of these cameras; their depth and weight alone
  PreparedCapture bounds;               // its near_plane, extent, scene_centre and scene_radius
  std::vector<InitialPoint> points;     // static
};

// Writes the findings atomically. `identity` describes the windows that they belong to. kIo on
// failure.
Status write_findings(const std::string& path, const std::string& identity,
                      const StaticFindings& findings);

// Reads findings. kIo, kInvalidFile for a damaged file, kUnsupported for one of another version,
// kUsage if they belong to windows with another identity.
Result<StaticFindings> read_findings(const std::string& path, const std::string& identity);

}  // namespace stgs::encoder
