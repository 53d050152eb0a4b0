// SPDX-License-Identifier: Apache-2.0
// Long captures: windows of time that overlap, trained as jobs of their own, and merged.
//
// A window is a capture whose frame 0 is one of the whole capture's; its scene remembers which. All
// windows have the same cameras, the same static initial points (where a window has room for fewer,
// the first part of the same choice), the same background and, as the mean of the cameras' colour
// corrections is the identity in each, the same colours.
#pragma once

#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct FrameSpan {
  int begin = 0, end = 0;  // [begin, end)
  int size() const { return end - begin; }
  bool operator==(const FrameSpan&) const = default;
};

// Cuts [0, frames) into windows of `length` frames, each of which shares `overlap` with the next;
// the last is as long as the others and may share more. One window where the capture is no longer
// than that. kUsage unless 0 <= overlap < length.
Result<std::vector<FrameSpan>> plan_windows(int frames, int length, int overlap);

// The frames of a span of a whole capture. kUsage where it does not lie in it.
Result<PreparedCapture> extract_window(const PreparedCapture& capture, const FrameSpan& span);

// The capture that a window is of; what is no window is itself.
PreparedCapture whole_of(const PreparedCapture& window);

// What of a capture a scene shows: all of it, or the window that it is. kUsage where it is one of
// another capture.
Result<PreparedCapture> capture_for_scene(const PreparedCapture& capture,
                                          const SceneMetadata& scene, const std::string& name);

// Whether a scene has the moments of what a capture shows of it (capture_for_scene); kUsage where
// not.
Status check_same_times(const PreparedCapture& shown, const SceneMetadata& scene,
                        const std::string& name);

// Warns where no camera of a capture stands where the scene's start camera does: a scene that was
// trained here has one of its capture's, so that what is measured may be of another place. A scene
// without a start camera tells nothing. `log` may be null.
void warn_if_other_capture(const PreparedCapture& capture, const SceneMetadata& scene,
                           const std::string& name, const LogSink& log);

// What windows must have been trained with alike to be merged, as a number:
// CaptureWindow::training. The hyper-parameters as they are used, however they were written, the
// ablation, the time limit and the content of the perceptual loss's file; not the seed. Reads that
// file. kUsage where a setting is none, else the backend's or the file's error.
Result<std::uint64_t> settings_id(const TrainSettings& settings);

// A window's scene, with its name for messages.
struct WindowScene {
  std::string name;
  Scene scene;
};

// In the order of time; a scene that is no window comes first.
bool comes_before(const Scene& a, const Scene& b);

// The scene of the whole capture from those of its windows, in any order: moments on the capture's
// clock, each window a part (spec/stgs-format.md 5.10) that is drawn up to the middle of what it
// shares with the next; parts are in the order of time. At least two. Backgrounds that differ by
// rounding become the first window's, and `log`, which may be null, tells. kUsage where they are
// not windows of one capture, were not trained alike, or leave frames out.
Result<Scene> merge_windows(std::vector<WindowScene> windows, const LogSink& log = {});

}  // namespace stgs::encoder
