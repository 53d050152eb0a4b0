// SPDX-License-Identifier: Apache-2.0
// Long captures: overlapping windows of time, trained as separate jobs and then merged.
//
// A window is a capture whose frame 0 is a later frame of the complete capture; its scene records
// that frame. All windows share:
// - the cameras and the background;
// - the static initial points (a window with capacity for fewer takes the first part of the same
//   selection);
// - the colours, because the mean of the cameras' colour corrections is the identity in each.
#pragma once

#include <string>
#include <vector>

#include "stgs/encoder/prepare.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Cuts [0, frames) into windows of `length` frames, each of which shares `overlap` frames with the
// next. The last window has the same length and may share more. Returns a single window if the
// capture is no longer than `length`. kUsage unless 0 <= overlap < length.
Result<std::vector<FrameSpan>> plan_windows(int frames, int length, int overlap);

// Returns a window: the frames of a span of a complete capture. kUsage if the span is out of range.
Result<PreparedCapture> extract_window(const PreparedCapture& capture, const FrameSpan& span);

// Returns the complete capture that a window belongs to, or the capture itself if it is no window.
PreparedCapture full_capture(const PreparedCapture& window);

// Returns the part of a capture that a scene covers: the complete capture, or a window of it.
// `name` identifies the scene in messages. kUsage if the scene is a window of another capture.
Result<PreparedCapture> capture_for_scene(const PreparedCapture& capture,
                                          const SceneMetadata& scene, const std::string& name);

// Checks that a scene has the frame count and time base of `covered` (from capture_for_scene).
// Returns kUsage if not.
Status check_same_times(const PreparedCapture& covered, const SceneMetadata& scene,
                        const std::string& name);

// Warns if no camera of the capture has the pose of the scene's start camera. Training takes the
// start camera from its capture, so the scene is probably of another capture or calibration, and
// measurements would be meaningless. Silent for a scene without a start camera. `log` may be null.
void warn_if_other_capture(const PreparedCapture& capture, const SceneMetadata& scene,
                           const std::string& name, const LogSink& log);

// Returns a hash of the settings that windows must share to be merged (CaptureWindow::training):
// the effective hyper-parameters, the ablation, the time limit and the content of the perceptual
// loss's file, but not the seed. Reads that file. kUsage for an invalid setting, else the error of
// the backend or the file.
Result<std::uint64_t> settings_id(const TrainSettings& settings);

// A window's scene, with its name for messages.
struct WindowScene {
  std::string name;
  Scene scene;
};

// Orders scenes by the first frame of their window; a scene that is no window comes first.
bool starts_before(const Scene& a, const Scene& b);

// Merges the scenes of a capture's windows, at least two and in any order, into one scene of the
// complete capture. Times are on the capture's clock. Each window becomes a part
// (spec/stgs-format.md 5.10), rendered up to the middle of its overlap with the next; parts are in
// time order. Backgrounds that differ by rounding are replaced with the first window's, which `log`
// (may be null) reports. kUsage if the scenes are not windows of one capture, were trained with
// different settings, or leave frames out.
Result<Scene> merge_windows(std::vector<WindowScene> windows, const LogSink& log = {});

}  // namespace stgs::encoder
