// SPDX-License-Identifier: Apache-2.0
// The common form into which every layout of a source capture is read.
//
// STGS puts the centre of the first pixel at +0.5. Layouts with the centre at 0 gain 0.5 in the
// principal point when they are read:
//
//   layout        first pixel's centre   reason
//   n3dv          0.5                    LLFF has no principal point: it is half the image size
//   panoptic      0.5                    projection in Dynamic 3D Gaussians
//   easyvolcap    0                      OpenCV calibration
//   colmap        0.5                    COLMAP convention
//   nerfstudio    0.5                    written from COLMAP models and read that way
//   videos        0.5 or 0               "pixel_centre" in cameras.json; see videos.cpp
//                 0                      calibrations of other tools; see calibration.h
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "stgs/encoder/capture_folder.h"
#include "stgs/encoder/prepare.h"

namespace stgs::encoder {

enum class LensModel {
  kPinhole,  // no distortion
  kOpenCv,   // OpenCV's radial and tangential model
  kFisheye,  // OpenCV's fisheye model
};

// One static camera. Either `video` or `images` is set.
struct SourceCamera {
  std::string name;
  int width = 0, height = 0;              // size that the intrinsics are for; 0: size of the frames
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels; pixel centres at +0.5
  LensModel lens = LensModel::kPinhole;
  std::vector<double> distortion;  // kOpenCv: k1 k2 p1 p2 [k3 [k4 k5 k6]]; kFisheye: k1 k2 k3 k4
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // world to camera, OpenCV axes, row-major
  double translation[3] = {0, 0, 0};                 // scene units
  bool test = false;                                 // held out by the split of the layout
  std::string video;                                 // path
  std::vector<std::string> images;                   // paths in temporal order
  bool numbered = false;                             // the image names end in the frame number
  std::vector<std::string> masks;   // empty, or one path per frame; 255 (or 1) = moving
  double time_offset = 0, fps = 0;  // as in Camera
  std::string live_source;  // of a rig (load_rig()): path or URL; empty: `video` or `images`
};

struct SourceCapture {
  Layout layout = Layout::kAuto;
  std::string folder;
  std::shared_ptr<const CaptureFolder> files;  // of `folder`; opens every path below
  std::vector<SourceCamera> cameras;
  bool split_known = false;  // the layout states the held-out cameras, possibly none
  double fps = 0;            // stated by the layout; 0: not stated (videos state their own)
  bool metric = false;       // scene units are metres
  bool has_timing = false;   // cameras state their times, and need not be synchronised
  bool masks_are_not_motion = false;  // masks/ belongs to the layout and marks valid pixels
  std::string flow_folder;            // holds CAM/NNNNNN.flo for some cameras; empty: no flow
  std::vector<InitialPoint> points;   // static points that came with the capture
};

// Returns the command-line name of a layout.
std::string_view layout_name(Layout layout);

// Reads the description of the capture in `folder`, but not its frames. Detects the layout if
// settings.layout is kAuto. The result has:
//   - at least one camera, with unique names that are valid folder names;
//   - a frame source and a rigid pose for each camera;
//   - the masks/, flow/ and timing.json next to the frames, which are independent of the layout.
// Errors include a capture beyond kCaptureLimits, and a path or link that leaves the folder unless
// settings.allow_outside.
// Errors include masks/ or flow/ without anything for any camera, and flow of a camera with lens
// distortion (frames are undistorted, flow is not). `progress` and `log` also serve the calibration
// of uncalibrated videos, which uses settings.first_frame.
Result<SourceCapture> load_source(const std::string& folder, const PrepareSettings& settings,
                                  const ProgressSink& progress, const LogSink& log);

// Checks the cameras of a capture, and corrects poses that are nearly rigid. The cameras of a rig
// need no frames.
Status check_source(SourceCapture& capture, bool is_rig);
// kInvalidFile for a capture of one camera, which has no depth.
Status check_camera_count(const std::string& folder, const std::vector<SourceCamera>& cameras);

// The layout loaders. They may throw; load_source() catches.
Result<SourceCapture> load_n3dv(const CaptureFolder& files);
Result<SourceCapture> load_panoptic(const CaptureFolder& files);
Result<SourceCapture> load_easyvolcap(const CaptureFolder& files);
Result<SourceCapture> load_colmap(const CaptureFolder& files);
Result<SourceCapture> load_nerfstudio(const CaptureFolder& files, const LogSink& log);
Result<SourceCapture> load_videos(const std::shared_ptr<const CaptureFolder>& files,
                                  const PrepareSettings& settings, const ProgressSink& progress,
                                  const LogSink& log);

// Reads the cameras of a rig that films now: a file in the format of cameras.json, whose cameras
// may have a "source". The others may have frames next to the file, or none.
Result<SourceCapture> load_rig(const std::shared_ptr<const CaptureFolder>& files,
                               const std::string& path);

// Sets intrinsics, lens, pose and points by running COLMAP on one frame of each camera, for at most
// an hour. kRuntime names the cameras that COLMAP could not place; kNotBuilt if COLMAP is not
// installed.
Status calibrate(int frame, SourceCapture& capture, const ProgressSink& progress,
                 const LogSink& log);

// Returns the folder of the COLMAP model: sparse/0, sparse or the folder itself. Empty if there is
// none.
std::string colmap_model_folder(const CaptureFolder& files);

}  // namespace stgs::encoder
