// SPDX-License-Identifier: Apache-2.0
// Reads the frames of one camera while they are filmed, or as if they were.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>

#include "camera_plan.h"
#include "source_capture.h"
#include "video_device.h"

namespace stgs::encoder {

// Common to all cameras of a rig. Thread-safe.
class LiveClock {
 public:
  using Clock = std::chrono::steady_clock;

  // Restarts the clock, which otherwise counts from its construction.
  void start(double fps);
  double fps() const { return fps_; }
  // Returns the seconds since the start.
  double now() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  // Returns the time of the image with this number in a growing folder. The first call, for any
  // folder, defines that its image is of the present time.
  double of_number(std::int64_t number);

 private:
  Clock::time_point start_ = Clock::now();
  double fps_ = 30;
  std::mutex mutex_;
  std::optional<std::pair<std::int64_t, double>> first_;  // number and its time
};

// Receives the time of a frame on the clock of the rig, seconds, and the frame, 8-bit BGR, changed
// by the mapping of the camera. An error ends the source.
using SourceFrameSink = std::function<Status(double seconds, const cv::Mat& bgr)>;

// How a source is read.
struct LiveReading {
  std::function<bool()> stopped;  // asked often; true ends the source
  bool allow_outside = false;     // paths of `live_source` may leave the folder of the rig
  VideoDecoding decoding;         // of videos and streams
  LogSink log;
  // Returns the mapping of the camera for frames of a size; an error if it is not that of the
  // first.
  std::function<Result<const FrameMapping*>(cv::Size size)> mapping;
};

// Reads a camera until its source ends or reading.stopped returns true:
// - a video, or the images of a recorded capture, at the rate of the rig: frame n at n / fps;
// - a growing folder of images (`live_source`): every image that appears after the start, when it
//   is complete. Its time follows from the number in its name, or from its position if the names
//   have no numbers. An image that cannot be decoded is skipped. The source ends kFolderSilence
//   seconds after its last image;
// - a stream or a named pipe (`live_source`), by its own timestamps, aligned by the frames that
//   arrive with the least delay, and realigned after a jump of more than kMaxDrift seconds. A lost
//   stream is opened again every second; a pipe ends with its writer.
// Logs the decoder of the source, and its end. Errors: kIo and kInvalidFile for a source that
// cannot be read, kUnsupported for one that the required device cannot decode, and those of the
// sink.
Status read_live_source(const CaptureFolder& files, const SourceCamera& camera, LiveClock& clock,
                        const SourceFrameSink& sink, const LiveReading& reading);

// Returns whether a camera is read from a video, a pipe or a stream. False also if it has none of
// the sources.
bool is_video_source(const CaptureFolder& files, const SourceCamera& camera, bool allow_outside);

// Checks the source of a camera before it is read: its kind, its existence, and that it does not
// leave the folder of the rig. kUsage for a URL of another scheme than kStreamSchemes.
Status check_live_source(const CaptureFolder& files, const SourceCamera& camera,
                         bool allow_outside);

inline constexpr double kFolderSilence = 10;
inline constexpr double kMaxDrift = 0.5;

}  // namespace stgs::encoder
