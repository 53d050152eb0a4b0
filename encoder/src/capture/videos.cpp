// SPDX-License-Identifier: Apache-2.0
// Layout "videos": one video or image folder per camera, in videos/, images/ or the folder itself.
// The calibration is in cameras.json next to them, or in a file of another tool (calibration.h).
// Without either, COLMAP calibrates from one frame of each camera.
//
// cameras.json contains a list of cameras, or an object from names to cameras. Either may also be
// the value of "cameras" in an object with "pixel_centre", "fps" and "metric" for all cameras.
// Keys of a camera (others are ignored):
//   "name"             name of its video or folder; implied if cameras are keyed by name
//   "K"                3x3, pixels
//   "w2c"              3x4 or 4x4, world to camera, OpenCV axes (x right, y down, z forward)
//   "dist"             optional, OpenCV order: k1 k2 p1 p2 [k3 [k4 k5 k6]]; fisheye: k1 k2 k3 k4
//   "fisheye"          optional, true: "dist" is of OpenCV's fisheye model
//   "width", "height"  optional, the image size that K is for; default: the size of the frames
//   "pixel_centre"     optional, coordinate of the first pixel's centre in K: 0.5 (default), or 0
//                      as in OpenCV calibrations
//   "test"             optional, true: held out
//   "source"           optional, for stgs live: path relative to this file, or URL
#include <algorithm>

#include "calibration.h"
#include "capture_files.h"
#include "json_error.h"
#include "json_read.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::json;

Result<SourceCamera> read_camera(const Json& json, const std::string& name, double pixel_centre,
                                 const std::string& path) {
  SourceCamera camera;
  camera.name = json.value("name", name);
  const std::string where = path + ": camera '" + camera.name + "'";
  for (const char* key : {"K", "w2c"}) {
    if (!json.contains(key)) return invalid_file("{}: \"{}\" is missing", where, key);
  }
  pixel_centre = json.value("pixel_centre", pixel_centre);
  if (pixel_centre != 0 && pixel_centre != 0.5) {
    return invalid_file("{}: pixel_centre is {} (expected 0 or 0.5)", where, pixel_centre);
  }
  STGS_ASSIGN(const std::vector<double> k, json_numbers(json.at("K"), where + ": K"));
  STGS_TRY(set_intrinsics(k, pixel_centre, where, camera));
  STGS_ASSIGN(const std::vector<double> w2c, json_numbers(json.at("w2c"), where + ": w2c"));
  STGS_TRY(set_pose(w2c, where, camera));
  STGS_ASSIGN(const std::vector<double> dist,
              json_numbers(json.value("dist", Json::array()), where + ": dist"));
  const bool fisheye = json.value("fisheye", false);
  if (fisheye || !dist.empty()) STGS_TRY(set_distortion(dist, fisheye, where, camera));
  if (json.contains("width")) {
    STGS_ASSIGN(camera.width, exact<int>(json, "width", 0, kMaxImageSide, where));
  }
  if (json.contains("height")) {
    STGS_ASSIGN(camera.height, exact<int>(json, "height", 0, kMaxImageSide, where));
  }
  if ((camera.width == 0) != (camera.height == 0)) {
    return invalid_file("{}: invalid size {}x{} (expected both width and height, or none)", where,
                        camera.width, camera.height);
  }
  camera.test = json.value("test", false);
  camera.live_source = json.value("source", "");
  return camera;
}

Status read_cameras(const CaptureFolder& files, const std::string& path, SourceCapture& capture) {
  STGS_ASSIGN(const Json top, read_json(files, path));
  try {
    const bool wrapped = top.is_object() && top.contains("cameras");
    const Json& cameras = wrapped ? top.at("cameras") : top;
    if (!cameras.is_array() && !cameras.is_object()) {
      return invalid_file(
          "{}: no cameras (expected a list of cameras, or an object from names to cameras)", path);
    }
    STGS_TRY(check_camera_limit(cameras.size(), path));
    const double pixel_centre = wrapped ? top.value("pixel_centre", 0.5) : 0.5;
    if (wrapped) {
      capture.fps = top.value("fps", 0.0);
      capture.metric = top.value("metric", false);
    }
    for (const auto& [key, json] : cameras.items()) {
      const std::string name = cameras.is_object() ? key : "camera " + key;
      if (!json.is_object())
        return invalid_file("{}: '{}' is not a camera (expected an object with K and w2c, got {})",
                            path, name, json.type_name());
      if (cameras.is_array() && !json.contains("name")) {
        return invalid_file("{}: {} of the list has no \"name\"", path, name);
      }
      STGS_ASSIGN(SourceCamera camera, read_camera(json, name, pixel_centre, path));
      capture.split_known |= json.contains("test");
      capture.cameras.push_back(std::move(camera));
    }
  } catch (const Json::exception& error) {
    return invalid_file("{}: {}", path, json_error(error));
  }
  return {};
}

Status attach_frames(const std::string& folder, const std::vector<SourceCamera>& found,
                     SourceCapture& capture, const LogSink& log) {
  for (SourceCamera& camera : capture.cameras) {
    const auto it = std::find_if(found.begin(), found.end(), [&](const SourceCamera& other) {
      return other.name == camera.name;
    });
    if (it == found.end()) {
      return io_error(
          "{}: no frames for camera '{}' of cameras.json; looked for a video or image folder of "
          "that "
          "name in videos/, images/ and the folder itself",
          folder, camera.name);
    }
    camera.video = it->video;
    camera.images = it->images;
    camera.numbered = it->numbered;
  }
  for (const SourceCamera& other : found) {
    const bool known = std::any_of(capture.cameras.begin(), capture.cameras.end(),
                                   [&](const SourceCamera& c) { return c.name == other.name; });
    if (!known) log(1, folder + ": '" + other.name + "' ignored (not in cameras.json)");
  }
  return {};
}

// Adds the calibration files that were not read to the message of a failed calibration.
Status with_ignored_files(const Status& status, const std::vector<std::string>& ignored) {
  if (status.ok() || ignored.empty()) return status;
  return {status.code(), fmt::format("{}; these files were ignored because they are no calibration "
                                     "with poses in a known format: {}",
                                     status.message(), fmt::join(ignored, ", "))};
}

}  // namespace

Result<SourceCapture> load_videos(const std::shared_ptr<const CaptureFolder>& files,
                                  const PrepareSettings& settings, const ProgressSink& progress,
                                  const LogSink& log) {
  const std::string& folder = files->path();
  SourceCapture capture;
  capture.folder = folder;
  capture.files = files;
  STGS_ASSIGN(std::vector<SourceCamera> found, find_cameras(*files));
  if (files->exists(folder + "/cameras.json")) {
    STGS_TRY(read_cameras(*files, folder + "/cameras.json", capture));
    STGS_TRY(attach_frames(folder, found, capture, log));
  } else {
    STGS_TRY(check_camera_count(folder, found));
    if (found.empty()) {
      return io_error(
          "{}: no videos or image folders found in videos/, images/ and the folder itself", folder);
    }
    STGS_ASSIGN(CalibrationSearch search, find_calibration(*files, found, log));
    if (!search.path.empty()) {
      capture.cameras = std::move(search.calibration.cameras);
      capture.metric = search.calibration.metric;
      return capture;
    }
    capture.cameras = std::move(found);
    if (!settings.may_calibrate) {
      return usage_error(
          "{}: has no calibration, and several processes cannot share that of COLMAP; run 'stgs "
          "prepare' on a few frames of it, and copy rig.json from there to {}/cameras.json",
          folder, folder);
    }
    STGS_TRY(with_ignored_files(calibrate(settings.first_frame, capture, progress, log),
                                search.ignored));
  }
  return capture;
}

Result<SourceCapture> load_rig(const std::shared_ptr<const CaptureFolder>& files,
                               const std::string& path) {
  SourceCapture rig;
  rig.layout = Layout::kVideos;
  rig.folder = files->path();
  rig.files = files;
  STGS_TRY(read_cameras(*files, path, rig));
  STGS_ASSIGN(const std::vector<SourceCamera> found, find_cameras(*files));
  for (SourceCamera& camera : rig.cameras) {
    for (const SourceCamera& other : found) {
      if (other.name != camera.name || !camera.live_source.empty()) continue;
      camera.video = other.video;
      camera.images = other.images;
      camera.numbered = other.numbered;
    }
  }
  STGS_TRY(check_source(rig, true));
  return rig;
}

}  // namespace stgs::encoder
