// SPDX-License-Identifier: Apache-2.0
// Windows of time of a longer capture: a capture whose frame 0 is a later frame of the complete
// capture. A scene of a single window records that frame (spec 4.5).
#pragma once

#include <string>

#include "stgs/encoder/prepare.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Returns a window: the frames of a span of a complete capture. kUsage if the span is out of range.
Result<PreparedCapture> extract_window(const PreparedCapture& capture, const FrameSpan& span);

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

// Returns a hash of the training settings that all windows of a run share: the effective
// hyper-parameters, the ablation, the time limit and the content of the perceptual loss's file, but
// not the seed. Reads that file. kUsage for an invalid setting, else the error of the backend or
// the file.
Result<std::uint64_t> settings_id(const TrainSettings& settings);

}  // namespace stgs::encoder
