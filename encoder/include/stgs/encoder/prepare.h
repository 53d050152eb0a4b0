// SPDX-License-Identifier: Apache-2.0
// Converts a capture in a common multi-view layout to a prepared capture (paper 3.3).
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "stgs/format/parameter.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Layouts of the source capture. encoder/src/capture has one file for each, which describes it.
enum class Layout {
  kAuto,        // detect the layout from the files in the folder
  kN3dv,        // Neural 3D Video: videos and poses_bounds.npy (LLFF)
  kPanoptic,    // CMU Panoptic as in Dynamic 3D Gaussians: train_meta.json
  kEasyVolcap,  // EasyVolcap and EasyMocap: intri.yml and extri.yml
  kColmap,      // COLMAP model in sparse/
  kNerfstudio,  // nerfstudio: transforms.json
  kVideos,      // videos or image folders, calibrated by cameras.json or by COLMAP
};

// The names of the layouts on the command line and in prepared captures; index: Layout.
inline constexpr std::array<std::string_view, 7> kLayoutNames = {
    "auto", "n3dv", "panoptic", "easyvolcap", "colmap", "nerfstudio", "videos"};

// PrepareParameters describes the numbers.
struct PrepareSettings {
  Layout layout = Layout::kAuto;
  int first_frame = 0, end_frame = -1;  // source frames [first, end); end -1: the last frame
  double scale = 1.0;
  std::vector<std::string> test_cameras;  // names; empty: the split of the layout
  bool default_test_cameras = true;       // false: hold out exactly test_cameras, even if empty
  // Name of a protocol (protocol.h), which apply_protocol() sets; "": none. Its test camera
  // replaces that of the layout.
  std::string protocol;
  double fps = 0;
  bool separate_motion = true;  // false: one static point cloud from the first frame
  int max_dynamic_points = 0;
  int max_static_points = 0;
  std::uint64_t seed = 1;
  // Of converting and undistorting frames, of stereo, sweeps, motion and velocities: "auto", "cpu",
  // "cuda".
  std::string backend = "auto";
  // The decoder of videos: "cpu"; "cuda", the NVIDIA GPU's decoder of H.264, HEVC and VP9, an
  // error (kUnsupported, kNotBuilt) if it cannot be used; "auto", the GPU where it can be used
  // and the videos are long enough for its start to pay, unless the backend is "cpu". The frames
  // are the same.
  std::string video_decoder = "auto";
  MachineShare share;
  bool overwrite = false;  // replace an existing prepared capture at the target
  // Allow the capture to name files outside its folder, directly or by links: it is trusted.
  bool allow_outside = false;
  // Calibrate a capture without a calibration with COLMAP, whose results differ between runs;
  // false: refuse it (kUsage).
  bool may_calibrate = true;
  // A calibration that a known mistake explains is a warning instead of an error.
  bool trust_calibration = false;
  // Called on the calling thread once cameras, image sizes and frames are known, before the long
  // work starts. An error cancels the run and is returned. May be empty.
  std::function<Status(const PreparedCapture&)> accept;
};

// The table (stgs/format/parameter.h) of PrepareSettings and stgs_prepare_settings.
struct PrepareParameters {
  template <typename Visit>
  static void for_each(Visit visit) {
    STGS_VISIT(visit, scale, 0.01, 1, "Scale factor of the images");
    STGS_VISIT(visit, fps, 0.001, 100000, "Frame rate of image folders", "frames per second",
               "the value of the layout");
    STGS_VISIT(visit, max_dynamic_points, 1, 1e9,
               "Maximum number of dynamic initial points per frame", "", "a choice by image size");
    STGS_VISIT(visit, max_static_points, 1, 1e9, "Maximum number of static initial points", "",
               "a choice by image size");
  }
};

// Least frames of a window of time. In fewer, moving content looks static.
inline constexpr int kMinWindowFrames = 8;

// A range of frames [begin, end).
struct FrameSpan {
  int begin = 0, end = 0;
  int size() const { return end - begin; }
  bool operator==(const FrameSpan&) const = default;
};

// Captures with more frames are encoded in windows by default.
inline constexpr int kMaxFramesAtOnce = 300;
// WindowPreparer::open() chooses the windows.
inline constexpr int kDefaultWindow = -1;

// Returns the default length of the windows of a capture: 2 seconds, but 8 to 300 frames; 0, which
// is all frames at once, if it has at most kMaxFramesAtOnce.
int default_window(int frames, const TimeBase& time_base);

// Cuts [0, frames) into windows of `length` frames. The last one is up to half as long again, or
// shorter, but not by more than half. length 0: one window.
std::vector<FrameSpan> cut_into_windows(int frames, int length);

// Prepares a capture one window of time after the other, so that the disk holds only one. One
// thread at a time.
class WindowPreparer {
 public:
  // Reads the description of the capture, and calls settings.accept with all its frames. `capture`
  // and `settings` as in prepare(). `window`: frames of a window; 0: the complete capture is one;
  // kDefaultWindow: default_window().
  static Result<std::unique_ptr<WindowPreparer>> open(const std::string& capture,
                                                      const PrepareSettings& settings, int window,
                                                      const ProgressSink& progress,
                                                      const LogSink& log);
  virtual ~WindowPreparer() = default;
  // Returns a description of all that the windows depend on: settings, cameras and the versions of
  // the files.
  virtual Result<std::string> identity() const = 0;
  // Returns the windows, in frames of the capture.
  virtual const std::vector<FrameSpan>& windows() const = 0;
  // Keeps the analysis of the first window in a file, from which another object can prepare the
  // later windows: prepare() writes it after the first window, and reads it for a later one. ""
  // (the default): in memory alone.
  virtual void keep_analysis(const std::string& path) = 0;
  // Prepares window `index` into `folder`, which appears complete or not at all, and returns the
  // window. Its frames are also in memory if they take at most a third of what is available; with
  // `files` false they are then in memory alone. There is no report without `files`. A window after
  // the first has the static points and the bounds of the first, which is analysed again if neither
  // this object has prepared it nor the file exists. A file of another capture or with
  // other settings is kUsage, a damaged one kInvalidFile. Prepare windows in ascending order: for
  // others, videos are decoded from the beginning.
  virtual Result<PreparedCapture> prepare(std::size_t index, const std::string& folder, bool files,
                                          const ProgressSink& progress, const LogSink& log) = 0;
};

// Prepares the folder `capture` into `folder`. The target appears complete or not at all.
// `progress` is called on the calling thread and cancels the run by returning false; it and `log`
// may be empty.
Status prepare(const std::string& capture, const std::string& folder,
               const PrepareSettings& settings, const ProgressSink& progress, const LogSink& log);

}  // namespace stgs::encoder
