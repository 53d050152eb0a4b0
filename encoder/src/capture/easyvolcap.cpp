// SPDX-License-Identifier: Apache-2.0
// Layout "easyvolcap": EasyVolcap and EasyMocap (ENeRF-Outdoor, SelfCap), with intri.yml and
// extri.yml as written by OpenCV.
//   intri.yml: names, the list of cameras XX; K_XX; D_XX or dist_XX; optional H_XX and W_XX.
//   extri.yml: T_XX; Rot_XX, or R_XX as a rotation vector; world to camera.
//   Frames are in images/XX/ or videos/XX.*, masks in masks/XX/ or mask/XX/.
#include <opencv2/core.hpp>

#include "capture_files.h"
#include "opencv_storage.h"

namespace stgs::encoder {
namespace {

constexpr double kPixelCentre = 0;  // OpenCV's convention

Status set_extrinsics(const Storage& extri, const std::string& where, SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<double> rotation,
              extri.numbers({"Rot_" + camera.name, "R_" + camera.name}));
  STGS_ASSIGN(const std::vector<double> t, extri.numbers({"T_" + camera.name}));
  if ((rotation.size() != 9 && rotation.size() != 3) || t.size() != 3) {
    return invalid_file(
        "{}: incomplete pose (expected Rot_{} with 9 numbers or R_{} with 3, and T_{} with 3)",
        where, camera.name, camera.name, camera.name);
  }
  return set_opencv_pose(rotation, t, where, camera);
}

// Sets the frames and the masks in mask/.
Status attach_frames(const CaptureFolder& files, SourceCamera& camera) {
  const std::string &folder = files.path(), &name = camera.name;
  bool found = false;
  for (const char* below : {"/images", "/videos"}) {
    if (found) break;
    STGS_ASSIGN(found, find_frames(files, folder + below, name, camera));
  }
  if (!found) {
    return io_error("{}: no frames for camera '{}' (looked for images/{}/ and videos/{}.mp4)",
                    folder, name, name, name);
  }
  if (files.is_folder(folder + "/masks/" + name)) return {};
  return find_masks(files, folder + "/mask", name, camera).status();
}

Result<SourceCamera> read_camera(const CaptureFolder& files, const std::string& name,
                                 const Storage& intri, const Storage& extri) {
  const std::string& folder = files.path();
  STGS_TRY(files.path_of(name, intri.path() + ": names").status());
  SourceCamera camera;
  camera.name = name;
  const std::string where = folder + "/intri.yml: camera '" + name + "'";
  STGS_ASSIGN(const std::vector<double> k, intri.numbers({"K_" + name}));
  STGS_TRY(set_intrinsics(k, kPixelCentre, where, camera));
  STGS_ASSIGN(std::vector<double> lens, intri.numbers({"D_" + name, "dist_" + name}));
  STGS_TRY(set_distortion(std::move(lens), false, where, camera));
  STGS_ASSIGN(const std::vector<double> height, intri.numbers({"H_" + name}));
  STGS_ASSIGN(const std::vector<double> width, intri.numbers({"W_" + name}));
  if (height.size() == 1 && width.size() == 1 && height[0] > 0 && width[0] > 0) {
    STGS_TRY(set_size(width[0], height[0], where, camera));
  }
  STGS_TRY(set_extrinsics(extri, folder + "/extri.yml: camera '" + name + "'", camera));
  STGS_TRY(attach_frames(files, camera));
  return camera;
}

// Returns a camera name: a text, or an integer as EasyMocap writes it.
Result<std::string> name_of(const cv::FileNode& node, const std::string& path) {
  if (node.isString()) return node.string();
  if (node.isInt()) return std::to_string(static_cast<int>(node));
  return invalid_file("{}: 'names' is not a list of camera names", path);
}

Result<SourceCapture> read_capture(const CaptureFolder& files) {
  STGS_ASSIGN(const Storage intri, Storage::open(files, files.path() + "/intri.yml"));
  STGS_ASSIGN(const Storage extri, Storage::open(files, files.path() + "/extri.yml"));
  SourceCapture capture;
  const cv::FileNode names = intri["names"];
  STGS_TRY(check_camera_limit(names.size(), intri.path()));
  for (const cv::FileNode& node : names) {
    STGS_ASSIGN(const std::string name, name_of(node, intri.path()));
    STGS_ASSIGN(SourceCamera camera, read_camera(files, name, intri, extri));
    capture.cameras.push_back(std::move(camera));
  }
  if (capture.cameras.empty()) return invalid_file("{}: 'names' lists no cameras", intri.path());
  return capture;
}

}  // namespace

Result<SourceCapture> load_easyvolcap(const CaptureFolder& files) {
  try {
    return read_capture(files);
  } catch (const cv::Exception& error) {
    return invalid_file("{}/intri.yml: 'names' is not a list of camera names: {}", files.path(),
                        error.err);
  }
}

}  // namespace stgs::encoder
