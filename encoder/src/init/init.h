// SPDX-License-Identifier: Apache-2.0
// Velocity-aware initialisation (paper 3.3): motion masks, dynamic points with velocities per
// frame, static points and scene bounds, from the frames of a prepared capture.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

namespace geometry {
class HullSweeper;
class MotionFinder;
class VelocityMatcher;
}  // namespace geometry
namespace init {
class LiveBackgrounds;
}

struct InitSettings {
  std::string name;  // of the capture, in messages
  // A known mistake in the calibration is a warning instead of an error, and points come from all
  // cameras.
  bool trust_calibration = false;
  bool separate_motion = true;   // false: one static point cloud from the first frame
  int max_dynamic_points = 0;    // per frame; 0: derived from the image size
  int max_static_points = 0;     // 0: derived from the image size
  std::uint64_t seed = 1;        // equal seeds give equal bytes with one backend
  std::string backend = "auto";  // of depth, motion, dynamic points and velocities
  int gpu = 0;                   // of the same, modulo the number of GPUs
  // Of a live capture, because its windows share them; null: on the CPU.
  std::shared_ptr<geometry::MotionFinder> motion_finder;
  std::shared_ptr<geometry::HullSweeper> sweeper;  // of dynamic points
  std::shared_ptr<geometry::VelocityMatcher> velocity_matcher;
  // Folder of precomputed optical flow: CAM/NNNNNN.flo (Middlebury) is the flow from source frame
  // NNNNNN to the next. Flow of another size is scaled to the prepared frames, which is correct
  // only without lens distortion. Flow is computed for cameras without a folder there. A camera
  // with a folder must have every file. Empty: no given flow.
  std::string flow_folder;
  std::shared_ptr<const CaptureFolder> flow_files;  // the capture of flow_folder; set with it
  // Points that came with the capture, in world space. Velocity and frame are ignored.
  std::vector<InitialPoint> points;
  bool write_report = true;
  // Of a capture that arrives window by window; null: another. Masks come from these backgrounds
  // alone and velocities from nearest neighbours. Synchronisation is not checked, because the
  // frames arrive with their times.
  std::shared_ptr<init::LiveBackgrounds> live;
  int point_interval = 1;  // every n-th frame has dynamic points (init/point_frames.h)
};

// The findings in the first window of a long capture that later windows use: the cameras that
// points come from, the depth of static content, the static points and the bounds.
struct StaticFindings;

// Computes the initial points of `capture`. Reads frames/ and existing masks/ of the training
// cameras; test cameras are never read. Missing masks and the points go to capture.memory, if it is
// set, and to masks/, points_static.ply and points_dynamic.ply unless it is capture.memory_only.
// Writes report/ if the settings ask for it. Sets near_plane, extent, scene_centre and
// scene_radius; the caller writes capture.json. Runs on all threads; the result does not depend on
// their number. A capture without motion gets no dynamic points. Errors: an unreadable frame (with
// camera and frame), an unwritable folder, a cancelled run (kRuntime). `findings` may be null.
Status initialise(PreparedCapture& capture, const InitSettings& settings,
                  const ProgressSink& progress, const LogSink& log,
                  std::shared_ptr<const StaticFindings>* findings = nullptr);

// The same for a later window of the capture, which gets masks and dynamic points of its own, and
// the static points and bounds of the first window. There is no report.
Status initialise_later(PreparedCapture& capture, const InitSettings& settings,
                        const StaticFindings& findings, const ProgressSink& progress,
                        const LogSink& log);

}  // namespace stgs::encoder
