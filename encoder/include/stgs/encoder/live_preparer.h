// SPDX-License-Identifier: Apache-2.0
// The cameras of a rig that films now, and the preparation of their frames window by window.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/encoder/prepare.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/parameter.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

inline constexpr Parameter kLiveFps = {
    "fps", 0.1, 1000, "Frames per second of the rig", "", "the value of the rig"};

// A camera of a rig.
struct LiveCamera {
  std::string name;
  // A path or URL; "": its frames are pushed by the application.
  std::string source;
};

// The calibration of a camera whose frames the application pushes.
struct RigCamera {
  std::string name;
  int width = 0, height = 0;               // image size of the intrinsics; 0: that of the frames
  double fx = 0, fy = 0, cx = 0, cy = 0;   // pixels; the centre of the first pixel is at 0.5
  bool fisheye = false;                    // the distortion is that of OpenCV's fisheye model
  std::vector<double> distortion;          // k1 k2 p1 p2 [k3 [k4 k5 k6]]; fisheye: k1 k2 k3 k4
  std::array<double, 12> world_to_camera;  // 3x4, row-major, OpenCV axes
};

// An image in the caller's memory, 8 bits per channel.
struct LiveImage {
  const std::uint8_t* data = nullptr;
  int width = 0, height = 0;  // pixels
  std::size_t stride = 0;     // bytes between rows
  bool bgr = false;           // the order of the channels; false: RGB
  bool has_alpha = false;     // a fourth channel follows, which is ignored
};

// Receives the frames of a source: seconds on the clock of the rig, which ascend unless the source
// jumps, and the prepared frame. Called on the thread of the source.
using LiveFrameSink = std::function<void(std::size_t camera, double seconds, Image8 frame)>;

class LivePreparer {
 public:
  // Reads the calibration: a file in the format of cameras.json (layout "videos"), in which a
  // camera may have a "source", or a folder with this file. Another folder is a recorded capture,
  // which plays as if it was filmed. Held-out cameras are left out. Of the settings, it uses scale,
  // the numbers of points, seed, backend, trust_calibration and allow_outside. `fps`: frames per
  // second of the rig; 0: the value of the file, or that of its videos.
  static Result<std::unique_ptr<LivePreparer>> open(const std::string& rig,
                                                    const PrepareSettings& settings, double fps,
                                                    const LogSink& log);
  // Uses the given calibration, without sources. `fps`: as above, not 0. kUsage for an invalid
  // camera, or fewer than two.
  static Result<std::unique_ptr<LivePreparer>> open(const std::vector<RigCamera>& cameras,
                                                    const PrepareSettings& settings, double fps);
  virtual ~LivePreparer() = default;

  virtual const std::vector<LiveCamera>& cameras() const = 0;
  virtual double fps() const = 0;

  // Undistorts and scales a frame. All frames of a camera have one size, else kUsage. Thread-safe
  // for different cameras.
  virtual Result<Image8> convert(std::size_t camera, const LiveImage& image) = 0;
  // Finds errors of read_source() before any camera is read: a camera without a source, a missing
  // file, a path that leaves the folder of the rig without settings.allow_outside.
  virtual Status check_sources() const = 0;
  // Reads the source of a camera until it ends or `stopped` returns true, and waits for its frames:
  // those of a video come at their own pace. kIo or kInvalidFile for a source that cannot be read;
  // streams that break off are opened again. Thread-safe for different cameras.
  virtual Status read_source(std::size_t camera, const LiveFrameSink& sink,
                             const std::function<bool()>& stopped, const LogSink& log) = 0;

  // Chooses the cameras that take part, each of which has converted a frame, and returns the
  // prepared capture without frames. Call it once, before prepare().
  virtual Result<PreparedCapture> start(const std::vector<bool>& takes_part) = 0;
  // Finds the initial points of a window, whose frames are in memory alone, and sets its bounds.
  // Its images and cameras may be smaller than those of the rig. `folder` receives capture.json and
  // the points. The first frame of the first window needs all cameras. Every `point_interval`-th
  // frame has dynamic points. One thread at a time.
  virtual Status prepare(PreparedCapture& window, int point_interval, const ProgressSink& progress,
                         const LogSink& log) = 0;
};

}  // namespace stgs::encoder
