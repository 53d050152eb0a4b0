// SPDX-License-Identifier: Apache-2.0
// The prepared capture: a folder that training and evaluation read without OpenCV or COLMAP.
//
//   capture.json            cameras, split, frames, time base, where everything came from
//   frames/CAM/NNNNNN.png   (or .jpg) undistorted, one size a camera
//   masks/CAM/NNNNNN.png    8-bit, 255 = moving; may be missing for a camera
//   points_static.ply       initial points: x y z red green blue
//   points_dynamic.ply      initial points: x y z red green blue vx vy vz frame
//   report/                 pictures and index.html for a person to look at
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// An undistorted pinhole camera. p_camera = rotation p_world + translation, OpenCV axes.
struct Camera {
  std::string name;                                  // also its folder's name
  int width = 0, height = 0;                         // pixels
  double fx = 0, fy = 0, cx = 0, cy = 0;             // pixels; pixel centres at +0.5
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // row-major
  double translation[3] = {0, 0, 0};                 // scene units
  bool test = false;                                 // held out of training

  math::PinholeCamera pinhole(float near_plane) const;
};

// 8-bit RGB, interleaved, row by row.
struct Image8 {
  int width = 0, height = 0, channels = 0;
  std::vector<std::uint8_t> data;
};

struct PreparedCapture {
  std::string folder;
  std::vector<Camera> cameras;
  int first_frame = 0;  // number of the first frame in the source
  int frames = 0;       // frame i of [0, frames) is moment i in ticks
  TimeBase time_base;   // one tick is one frame
  bool metric = false;  // scene units are metres
  std::string frame_extension = "png";
  std::string source;        // layout that it was prepared from
  float near_plane = 0.01f;  // scene units, chosen by prepare from the cameras and the points
  float extent = 1.0f;       // radius of the camera positions around their centre, scene units
  double scene_centre[3] = {0, 0, 0};
  double scene_radius = 1.0;  // of the initial points around scene_centre, 95 % of them
  // Where this is a part of the capture in the folder (windows.h): frame 0 is then the window's
  // first, for frame_path too.
  std::optional<CaptureWindow> window;

  // Frames of the folder before frame 0.
  int frame_offset() const { return window ? static_cast<int>(window->first_frame) : 0; }
  std::string frame_path(const Camera& camera, int frame) const;
  std::string mask_path(const Camera& camera, int frame) const;
};

// An initial point. Static ones have velocity 0 and frame -1.
struct InitialPoint {
  float position[3];
  std::uint8_t colour[3];  // RGB
  float velocity[3];       // scene units a frame, as measured
  int frame;               // index in [0, frames), or -1
};

// Reads and checks capture.json (not the pictures).
Result<PreparedCapture> read_prepared_capture(const std::string& folder);
Status write_prepared_capture(const PreparedCapture& capture);

// Decodes a frame to RGB; the error names file, camera and frame, also where the size is wrong.
Result<Image8> load_frame(const PreparedCapture& capture, const Camera& camera, int frame);
// One channel, 255 = moving; an empty image where the capture has no mask for it.
Result<Image8> load_mask(const PreparedCapture& capture, const Camera& camera, int frame);

// Binary little-endian PLY.
Result<std::vector<InitialPoint>> read_points(const std::string& path);
Status write_points(const std::string& path, const std::vector<InitialPoint>& points);

}  // namespace stgs::encoder
