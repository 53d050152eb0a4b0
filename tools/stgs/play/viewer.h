// SPDX-License-Identifier: Apache-2.0
// The player window.
#pragma once

#include <optional>
#include <string>

#include "options.h"
#include "play/playback.h"
#include "session.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

struct ViewerSettings {
  PlaybackSettings playback;
  std::optional<encoder::Camera> camera;  // default: the start camera, or an overview
  std::optional<Size> size;               // pixels; default: of the camera, scaled down to fit
  bool overlay = true;
  // If set: saves the window as PNG at frame `after` or later, once all layers of the current time
  // are available, and closes the window.
  std::string screenshot;
  int after = 1;
};

struct ViewerReport {
  std::string device;
  Size size;
  std::uint64_t frames = 0, stalls = 0;
  // Frames that followed their predecessor without idling, and the seconds that they took.
  std::uint64_t busy_frames = 0;
  double busy_seconds = 0;
  double seconds = 0;      // clip time of the last frame
  encoder::Camera camera;  // of the last frame
  Status screenshot;       // kRuntime if it was written but is incomplete
};

// Opens a window, plays the file, and returns when the window is closed. Call on the main thread.
// kUnsupported without a display or a Vulkan device that can present; kRuntime if interrupted; the
// errors of opening and rendering the file.
Result<ViewerReport> run_viewer(Session& session, const ViewerSettings& settings);

}  // namespace stgs::tools
