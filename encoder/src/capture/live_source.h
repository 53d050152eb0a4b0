// SPDX-License-Identifier: Apache-2.0
// Reads the frames of one camera while they are filmed, or as if they were.
#pragma once

#include <chrono>
#include <functional>
#include <opencv2/core.hpp>
#include <string>

#include "source_capture.h"

namespace stgs::encoder {

// Common to all cameras of a rig.
struct LiveClock {
  using Clock = std::chrono::steady_clock;

  Clock::time_point start = Clock::now();
  double fps = 30;

  double now() const { return std::chrono::duration<double>(Clock::now() - start).count(); }
};

// Receives the time of a frame on the clock of the rig, seconds, and the frame, 8-bit BGR. An error
// ends the source.
using SourceFrameSink = std::function<Status(double seconds, const cv::Mat& bgr)>;

// Reads a camera until its source ends or `stopped` returns true:
// - a video at the rate of the rig, frame n at n / fps;
// - a folder of images that grows: the image with number n at n / fps, as soon as it is complete,
//   but not earlier; without numbers they count from 0. An image that cannot be decoded is skipped.
//   It ends after kFolderSilence seconds without a further image;
// - a stream or a named pipe (`live_source`), by its own timestamps, which begin when its first
// frame
//   arrives. Where they differ from the arrival by more than kMaxDrift seconds, they begin again. A
//   stream that breaks off is opened again every second; a pipe ends with its writer.
// Errors: kIo and kInvalidFile for a source that cannot be read, and those of the sink.
Status read_live_source(const CaptureFolder& files, const SourceCamera& camera,
                        const LiveClock& clock, const SourceFrameSink& sink,
                        const std::function<bool()>& stopped, const LogSink& log);

inline constexpr double kFolderSilence = 10;
inline constexpr double kMaxDrift = 0.5;

}  // namespace stgs::encoder
