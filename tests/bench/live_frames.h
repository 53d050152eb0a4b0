// SPDX-License-Identifier: Apache-2.0
// The frames that bench_live pushes.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "stgs/encoder/live_preparer.h"

namespace stgs::bench {

// All frames are in memory. Thread-safe.
class LiveFrames {
 public:
  LiveFrames() = default;
  LiveFrames(const LiveFrames&) = delete;
  LiveFrames& operator=(const LiveFrames&) = delete;
  virtual ~LiveFrames() = default;
  // Of the cameras that film.
  virtual encoder::LivePreparer& preparer() = 0;
  // Returns the image that a camera films at frame n >= 0.
  virtual const encoder::Image8& frame(std::size_t camera, int n) const = 0;
  // Returns the PSNR in dB of a file at several frames of the first `frames`, in test cameras;
  // none without a ground truth.
  virtual Result<std::vector<double>> psnr(const std::string& path, int frames) const = 0;
};

// The frames of a prepared capture, played back and forth. `rig`: its cameras, in the format of
// cameras.json, without sources.
Result<std::unique_ptr<LiveFrames>> open_captured_frames(const std::string& prepared,
                                                         const std::string& rig,
                                                         const encoder::LogSink& log);

// `seconds` of the room of tests/fixtures/moving_room.h, which never repeat. `rig`:
// CAMERASxWIDTHxHEIGHT@FPS, such as 12x1920x1080@30; a test camera is added.
Result<std::unique_ptr<LiveFrames>> render_room_frames(const std::string& rig, double seconds);

}  // namespace stgs::bench
