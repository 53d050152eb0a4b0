// SPDX-License-Identifier: Apache-2.0
// Writes the frames and the given masks of a prepared capture.
#pragma once

#include "camera_plan.h"
#include "source_capture.h"

namespace stgs::encoder {

// Looks at every camera's frames and checks that they are synchronised: the same number of frames
// (or all of [settings.first_frame, settings.end_frame)), of the same moments where their names
// tell, the same rate; and that given flow lacks no frame. Fills in the cameras,
// frames, first_frame, time_base and frame_extension of `capture`, and applies the split.
// plans[i] is for source.cameras[i] and capture.cameras[i].
Result<std::vector<CameraPlan>> plan_frames(const SourceCapture& source,
                                            const PrepareSettings& settings,
                                            PreparedCapture& capture, const LogSink& log);

// Writes frames/ and masks/ (of training cameras) under capture.folder, on all threads. Frames that
// need no change keep their bytes if all cameras' do.
Status write_frames(const SourceCapture& source, const std::vector<CameraPlan>& plans,
                    const PreparedCapture& capture, const ProgressSink& progress);

}  // namespace stgs::encoder
