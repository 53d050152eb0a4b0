// SPDX-License-Identifier: Apache-2.0
// A capture as people have it, read but not yet changed: what every layout is brought to.
//
// Where a layout puts the centre of the first pixel, and so what its principal point means. Here,
// as everywhere in STGS, it is at +0.5; a layout with integer centres gains 0.5 when it is read.
//
//   layout        first pixel's centre   because
//   n3dv          0.5                    LLFF has no principal point: it is half the picture's size
//   panoptic      0.5                    as Dynamic 3D Gaussians projects it
//   easyvolcap    0                      OpenCV's calibration
//   colmap        0.5                    COLMAP's convention
//   nerfstudio    0.5                    written from COLMAP models, read so by nerfstudio
//   videos        0.5, or the field      cameras.json says "pixel_centre"; see videos.cpp
#pragma once

#include <string>
#include <vector>

#include "stgs/encoder/prepare.h"

namespace stgs::encoder {

enum class LensModel { kPinhole, kOpenCv, kFisheye };

struct SourceCamera {
  std::string name;
  int width = 0, height = 0;              // that the intrinsics are for; 0: those of the frames
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels; pixel centres at +0.5
  LensModel lens = LensModel::kPinhole;
  std::vector<double> distortion;  // kOpenCv: k1 k2 p1 p2 [k3 [k4 k5 k6]]; kFisheye: k1 k2 k3 k4
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // world to camera, OpenCV axes, row-major
  double translation[3] = {0, 0, 0};
  bool test = false;                // by the layout's own split
  std::string video;                // a file; or
  std::vector<std::string> images;  // files in order of time
  bool numbered = false;            // pictures: a folder's files, named by the frame's number
  std::vector<std::string> masks;   // none, or one file a frame; 255 (or 1) = moving
};

struct SourceCapture {
  Layout layout = Layout::kAuto;
  std::string folder;
  std::vector<SourceCamera> cameras;
  bool split_known = false;  // the layout says which cameras are held out, even if none
  double fps = 0;            // that the layout states; 0: it does not (videos state their own)
  bool metric = false;       // scene units are metres
  bool masks_are_not_motion = false;  // masks/ holds what the layout means by a mask
  std::string flow_folder;            // of CAM/NNNNNN.flo (some cameras'), or empty
  std::vector<InitialPoint> points;   // static points that came with the capture
};

const char* layout_name(Layout layout);

// Reads the description of the capture in `folder` (not its frames), recognising the layout if it
// is kAuto. The result has at least one camera, distinct names that can be folders, a frame source
// for each camera and poses that are rigid, and the masks and flow that lie beside any layout.
// Error: masks/ or flow/ with nothing for any camera; flow of a camera whose lens distorts, as the
// frames are undistorted and flow is not. `settings` and `progress` serve the calibration that
// uncalibrated videos need.
Result<SourceCapture> load_source(const std::string& folder, const PrepareSettings& settings,
                                  const ProgressSink& progress, const LogSink& log);

// The loaders, one a layout. They may throw OpenCV's and the file system's exceptions.
Result<SourceCapture> load_n3dv(const std::string& folder);
Result<SourceCapture> load_panoptic(const std::string& folder);
Result<SourceCapture> load_easyvolcap(const std::string& folder);
Result<SourceCapture> load_colmap(const std::string& folder);
Result<SourceCapture> load_nerfstudio(const std::string& folder, const LogSink& log);
Result<SourceCapture> load_videos(const std::string& folder, int first_frame,
                                  const ProgressSink& progress, const LogSink& log);

// Sets the cameras' intrinsics and poses by running COLMAP on one frame of each. Error: cameras
// that COLMAP could not place, by name; COLMAP not installed (kNotBuilt).
Status calibrate(int frame, SourceCapture& capture, const ProgressSink& progress,
                 const LogSink& log);

// Where the capture's COLMAP model is: sparse/0, sparse, or the folder; "" if nowhere.
std::string colmap_model_folder(const std::string& folder);

}  // namespace stgs::encoder
