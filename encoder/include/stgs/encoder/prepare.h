// SPDX-License-Identifier: Apache-2.0
// From a capture in a layout that people already have to a prepared capture (paper 3.3).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

enum class Layout { kAuto, kN3dv, kPanoptic, kEasyVolcap, kColmap, kNerfstudio, kVideos };

struct PrepareSettings {
  Layout layout = Layout::kAuto;
  int first_frame = 0, end_frame = -1;    // [first, end) of the source; -1: to the end
  double scale = 1.0;                     // of the frames, (0, 1]
  std::vector<std::string> test_cameras;  // names; empty: the layout's own split
  bool default_test_cameras = true;       // false: hold out exactly test_cameras, even none
  double fps = 0;               // for folders of pictures; 0: what the layout says, else 30
  bool separate_motion = true;  // false: one cloud from the first frame, all of it static
  int max_dynamic_points = 0;   // a frame; 0: chosen from the image size
  int max_static_points = 0;    // 0: chosen from the image size
  std::uint64_t seed = 1;
  bool overwrite = false;  // replace an existing prepared capture at the target
  // Asked once the cameras, the pictures' sizes and the frames are known, before the long work; an
  // error ends it.
  std::function<Status(const PreparedCapture&)> accept;
};

// Layout name on the command line <-> value.
Result<Layout> layout_from_name(const std::string& name);

// Prepares `capture` into `folder`, which appears complete or not at all.
Status prepare(const std::string& capture, const std::string& folder,
               const PrepareSettings& settings, const ProgressSink& progress, const LogSink& log);

}  // namespace stgs::encoder
