// SPDX-License-Identifier: Apache-2.0
// A scene in a window, until its viewer closes it.
#pragma once

#include <optional>
#include <string>

#include "options.h"
#include "play/playback.h"
#include "session.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

struct ShowSettings {
  PlaybackSettings playback;
  std::optional<encoder::Camera> camera;  // else the file's start camera, else one that sees all
  std::optional<Size> size;               // pixels; else the camera's, made smaller to fit
  bool overlay = true;
  // Where set: a PNG of what the window shows as its `after`th picture or later, once all of the
  // moment is there; then the window closes.
  std::string screenshot;
  int after = 1;
};

// What came of it.
struct ShowReport {
  std::string device;
  Size size;
  std::uint64_t pictures = 0, stalls = 0;
  std::uint64_t following = 0;  // of the pictures: at once after another
  double busy = 0;              // seconds from those to these
  double seconds = 0;           // the moment of the last picture
  encoder::Camera camera;       // of the last picture
};

// On the main thread. kUnsupported without a display or a Vulkan device that shows windows; errors
// of opening and drawing the file, kRuntime where it is interrupted.
Result<ShowReport> show(Session& session, const ShowSettings& settings);

}  // namespace stgs::tools
