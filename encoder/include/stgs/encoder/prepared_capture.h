// SPDX-License-Identifier: Apache-2.0
// The prepared capture: a folder that training and evaluation read without OpenCV or COLMAP.
//
//   capture.json            cameras, split, frames, time base, origin
//   frames/CAM/NNNNNN.png   (or .jpg) undistorted frames, one size per camera
//   masks/CAM/NNNNNN.png    8-bit motion masks, 255 = moving; optional for each camera
//   points_static.ply       initial points: x y z red green blue, and nx ny nz if any has a normal
//   points_dynamic.ply      initial points: x y z red green blue vx vy vz frame
//   report/                 index.html and its images, for visual inspection
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {
class ByteSource;
}

namespace stgs::encoder {

class CaptureFolder;
class FrameMemory;

// An undistorted pinhole camera with OpenCV axes: p_camera = rotation * p_world + translation.
struct Camera {
  std::string name;                                  // also the name of its folder
  int width = 0, height = 0;                         // pixels
  double fx = 0, fy = 0, cx = 0, cy = 0;             // pixels; pixel centres at +0.5
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // world to camera, row-major
  double translation[3] = {0, 0, 0};                 // scene units
  bool test = false;                                 // held out of training
  // Image j of the camera's own sequence is taken at time_offset + j / fps, in seconds of the
  // capture, of which frame n of the source is at n times the duration of a frame.
  double time_offset = 0;  // seconds
  double fps = 0;          // 0: that of the capture
  double time_shift = 0;   // not stored: by which training has corrected its times, frames

  // Returns the camera for the rasteriser, in single precision. `near_plane` is in scene units.
  math::PinholeCamera pinhole(float near_plane) const;
};

// An 8-bit image with interleaved channels (1 or 3, RGB), row by row without padding.
struct Image8 {
  int width = 0, height = 0, channels = 0;
  std::vector<std::uint8_t> data;
};

// The contents of capture.json. Scene units are the units of the source calibration.
struct PreparedCapture {
  std::string folder;
  std::shared_ptr<const CaptureFolder> files;  // opens the files; null: not read from a folder
  std::vector<Camera> cameras;
  int first_frame = 0;  // number of the first frame in the source
  int frames = 0;       // frame i of [0, frames) is at time i, in ticks, if all are synchronised
  TimeBase time_base;   // one tick is one frame
  bool metric = false;  // scene units are metres
  std::string frame_extension = "png";
  std::string source;        // layout of the source capture
  std::string protocol;      // by which it was prepared (protocol.h); "": by none
  float near_plane = 0.01f;  // scene units, derived from the cameras and the initial points
  float extent = 1.0f;       // radius of the camera positions around their centre, scene units
  double scene_centre[3] = {0, 0, 0};
  double scene_radius = 1.0;  // radius around scene_centre that holds 95 % of the initial points
  // Set if this object describes a window of the capture (windows.h). Frame 0 is then the first
  // frame of the window, for frame_path and mask_path too.
  std::optional<CaptureWindow> window;
  // Not stored. Frames, masks and points that are in memory, not owned by the folder; null: none.
  // With `memory_only` there are no files of them.
  std::shared_ptr<FrameMemory> memory;
  bool memory_only = false;
  // Not stored. If set, load_frame() has this RGB colour where a mask is below kMinMask.
  std::optional<std::array<std::uint8_t, 3>> mask_background;

  // Returns the number of frames in the folder that precede frame 0.
  int frame_offset() const { return window ? static_cast<int>(window->first_frame) : 0; }
  // Returns the cameras that are not held out, in order.
  std::vector<Camera> training_cameras() const;
  // Returns the index in the camera's own sequence of the image that is this frame: the one that is
  // taken nearest to it in time. It may lie outside the sequence.
  std::int64_t own_frame(const Camera& camera, int frame) const;
  // Returns the time at which a frame of a camera is taken, in ticks: `frame`, or up to half an
  // interval between its images before or after it, plus camera.time_shift.
  double time_of(const Camera& camera, int frame) const;
  // Returns the path of a frame or mask, which need not exist.
  std::string frame_path(const Camera& camera, int frame) const;
  std::string mask_path(const Camera& camera, int frame) const;
};

// The background of a scene that was trained with TrainSettings::foreground.
inline constexpr std::array<std::uint8_t, 3> kMaskBackground = {0, 0, 0};
inline constexpr std::uint8_t kMinMask = 128;  // inside

// An initial point. Static points have velocity 0 and frame -1.
struct InitialPoint {
  float position[3];
  std::uint8_t colour[3];       // RGB
  float velocity[3];            // scene units per frame, as measured
  int frame;                    // index in [0, frames), or -1
  float normal[3] = {0, 0, 0};  // unit normal of the surface; 0: unknown
};

// Reads and validates capture.json in `folder`. Does not open the frames. Unless `allow_outside`,
// files of the capture are refused if a link in the folder leads out of it. The folder itself may
// be a link. kIo if it cannot be opened, kInvalidFile if it is malformed or exceeds a limit
// (SECURITY.md), kUnsupported for another version.
Result<PreparedCapture> read_prepared_capture(const std::string& folder,
                                              bool allow_outside = false);
// Checks that the first and the last frame of the cameras exist, and that their folders have enough
// files for the frames between. Call it before work in proportion to capture.frames, which a
// damaged or hostile capture.json can overstate. kIo for a missing frame.
Status check_frame_files(const PreparedCapture& capture, const std::vector<Camera>& cameras);
// Opens a file of a capture.
Result<std::unique_ptr<ByteSource>> open_file_of(const PreparedCapture& capture,
                                                 const std::string& path);
// Validates `capture` and writes capture.json atomically into capture.folder.
Status write_prepared_capture(const PreparedCapture& capture);

// Returns whether there is a frame: false only for a capture in memory alone, if the camera
// delivered none at this time. Training leaves the view out.
bool has_frame(const PreparedCapture& capture, const Camera& camera, int frame);

// Decodes a frame to RGB, or copies it from memory. An error names file, camera and frame; a size
// other than the camera's is kInvalidFile, and so is a missing mask with capture.mask_background.
Result<Image8> load_frame(const PreparedCapture& capture, const Camera& camera, int frame);
// The same, without a copy of a frame in memory.
Result<std::shared_ptr<const Image8>> load_shared_frame(const PreparedCapture& capture,
                                                        const Camera& camera, int frame);
// Decodes a motion mask: one channel, 255 = moving. Returns an empty image if there is no mask.
Result<Image8> load_mask(const PreparedCapture& capture, const Camera& camera, int frame);

bool has_mask(const PreparedCapture& capture, const Camera& camera, int frame);
// Returns kInvalidFile for a missing mask that the foreground needs, with a remedy.
Status missing_mask(const PreparedCapture& capture, const Camera& camera, int frame);
// As load_frame(), with `colour` outside the mask. kInvalidFile if there is none.
Result<Image8> load_foreground(const PreparedCapture& capture, const Camera& camera, int frame,
                               const std::array<std::uint8_t, 3>& colour);

// Reads initial points from a binary little-endian PLY file. kInvalidFile for non-finite values.
Result<std::vector<InitialPoint>> read_points(const std::string& path);
Result<std::vector<InitialPoint>> read_points(const ByteSource& file);
// Writes initial points atomically as binary little-endian PLY.
Status write_points(const std::string& path, const std::vector<InitialPoint>& points);

}  // namespace stgs::encoder
