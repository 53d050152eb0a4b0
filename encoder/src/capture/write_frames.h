// SPDX-License-Identifier: Apache-2.0
// Writes the frames and the given masks of a prepared capture.
#pragma once

#include <memory>
#include <vector>

#include "camera_plan.h"
#include "frame_reader.h"
#include "source_capture.h"

namespace stgs::encoder {

// Checks that the cameras are synchronised and plans their undistortion. All cameras must have:
//   - the same number of frames, or all of [settings.first_frame, settings.end_frame);
//   - the same frame numbers, where file names contain them;
//   - the same frame rate;
// or state their times (timing_file.h) and have common frames. They must also have:
//   - a flow file for every frame, where flow is given.
// Sets cameras, split, frames, first_frame, time_base and frame_extension of `capture`. plans[i]
// belongs to source.cameras[i] and capture.cameras[i].
Result<std::vector<CameraPlan>> plan_frames(const SourceCapture& source,
                                            const PrepareSettings& settings,
                                            PreparedCapture& capture, const LogSink& log);

// The video of a camera, read from front to back.
struct SourceVideo {
  std::unique_ptr<VideoReader> reader;  // null: not opened
  std::int64_t next = 0;                // number of the next image in the video
  // The one before, of a camera with a frame rate of its own; changed if that happens on a GPU.
  cv::Mat latest;
};

// The videos of a capture while their frames are written range by range, one after the other.
struct OpenVideos {
  VideoDecoding decoding;
  MappingDevice mapping_device;
  std::vector<SourceVideo> videos;  // per camera
  int next_frame = 0;               // of the source
};

// Writes frames/ and the given masks/ to capture.folder and capture.memory, on all threads; with
// capture.memory_only to the latter alone. Frames are copied byte for byte if no camera needs a
// change. `videos`: those of an earlier call, which continue if the frames follow.
Status write_frames(const SourceCapture& source, const std::vector<CameraPlan>& plans,
                    const PreparedCapture& capture, OpenVideos& videos,
                    const ProgressSink& progress);

// Logs the decoders of the videos that write_frames() has read, and the reasons.
void log_decoders(const SourceCapture& source, const OpenVideos& videos, const LogSink& log);

}  // namespace stgs::encoder
