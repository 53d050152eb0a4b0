// SPDX-License-Identifier: Apache-2.0
// Velocity-aware initialisation (paper 3.3): motion masks, dynamic points a frame with their
// velocities, static points, and the scene's bounds, from the frames of a prepared capture.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct InitSettings {
  bool separate_motion = true;  // false: one cloud from the first frame, all of it static
  int max_dynamic_points = 0;   // a frame; 0: chosen from the image size
  int max_static_points = 0;    // 0: chosen from the image size
  std::uint64_t seed = 1;       // of what is drawn at random; equal seeds give equal bytes
  // Folder of optical flow computed elsewhere: CAM/NNNNNN.flo (Middlebury) holds the motion from
  // source frame NNNNNN to the next. Flow of another size than the prepared frames is scaled to
  // them, which is right where nothing had to be undistorted. "": none. A camera without a folder
  // there gets its flow computed; one with a folder must have every file.
  std::string flow_folder;
  // Points that came with the capture (world space); velocity and frame are ignored.
  std::vector<InitialPoint> points;
  bool use_colmap = true;  // triangulate features with COLMAP where it is installed
  bool write_report = true;
};

// Reads frames/ and, where present, masks/ of the training cameras under capture.folder; test
// cameras are never read. Writes the missing masks, points_static.ply, points_dynamic.ply and
// report/, and sets near_plane, extent, scene_centre and scene_radius in `capture` (capture.json is
// the caller's to write). Runs on TBB's threads; the result does not depend on their number.
// Errors: a frame that cannot be read (named with camera and frame), a folder that cannot be
// written, a cancelled run. A capture without any motion is no error: it has no dynamic points.
Status initialise(PreparedCapture& capture, const InitSettings& settings,
                  const ProgressSink& progress, const LogSink& log);

}  // namespace stgs::encoder
