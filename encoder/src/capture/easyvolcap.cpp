// SPDX-License-Identifier: Apache-2.0
// Layout "easyvolcap": EasyVolcap and EasyMocap (ENeRF-Outdoor, SelfCap), with intri.yml and
// extri.yml as written by OpenCV.
//   intri.yml: names, the list of cameras XX; K_XX; D_XX or dist_XX; optional H_XX and W_XX.
//   extri.yml: T_XX; Rot_XX, or R_XX as a rotation vector; world to camera.
//   Frames are in images/XX/ or videos/XX.*, masks in masks/XX/ or mask/XX/.
#include <filesystem>
#include <opencv2/core.hpp>

#include "capture_files.h"
#include "opencv_storage.h"

namespace stgs::encoder {
namespace {

constexpr double kPixelCentre = 0;  // OpenCV's convention

struct Yaml {
  std::string path;
  cv::FileStorage file;
};

Result<Yaml> open_yaml(const std::string& path) {
  STGS_ASSIGN(const cv::FileStorage file, open_storage(path));
  return Yaml{path, file};
}

Result<std::vector<double>> numbers(const Yaml& yaml, const std::vector<std::string>& keys) {
  return storage_numbers(yaml.file, keys, yaml.path);
}

Status set_extrinsics(const Yaml& extri, const std::string& where, SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<double> rotation,
              numbers(extri, {"Rot_" + camera.name, "R_" + camera.name}));
  STGS_ASSIGN(const std::vector<double> t, numbers(extri, {"T_" + camera.name}));
  if ((rotation.size() != 9 && rotation.size() != 3) || t.size() != 3) {
    return invalid_file(
        "{}: incomplete pose (expected Rot_{} with 9 numbers or R_{} with 3, and T_{} with 3)",
        where, camera.name, camera.name, camera.name);
  }
  return set_opencv_pose(rotation, t, where, camera);
}

Result<SourceCamera> read_camera(const std::string& folder, const std::string& name,
                                 const Yaml& intri, const Yaml& extri) {
  SourceCamera camera;
  camera.name = name;
  const std::string where = folder + "/intri.yml: camera '" + name + "'";
  STGS_ASSIGN(const std::vector<double> k, numbers(intri, {"K_" + name}));
  STGS_TRY(set_intrinsics(k, kPixelCentre, where, camera));
  STGS_ASSIGN(std::vector<double> lens, numbers(intri, {"D_" + name, "dist_" + name}));
  STGS_TRY(set_distortion(std::move(lens), false, where, camera));
  STGS_ASSIGN(const std::vector<double> height, numbers(intri, {"H_" + name}));
  STGS_ASSIGN(const std::vector<double> width, numbers(intri, {"W_" + name}));
  if (height.size() == 1 && width.size() == 1 && height[0] > 0 && width[0] > 0) {
    camera.height = static_cast<int>(height[0]);
    camera.width = static_cast<int>(width[0]);
  }
  STGS_TRY(set_extrinsics(extri, folder + "/extri.yml: camera '" + name + "'", camera));
  if (!find_frames(folder + "/images", name, camera) &&
      !find_frames(folder + "/videos", name, camera)) {
    return io_error("{}: no frames for camera '{}' (looked for images/{}/ and videos/{}.mp4)",
                    folder, name, name, name);
  }
  if (!std::filesystem::is_directory(folder + "/masks/" + name)) {
    STGS_TRY(find_masks(folder + "/mask", name, camera).status());
  }
  return camera;
}

Result<SourceCapture> read_capture(const std::string& folder) {
  STGS_ASSIGN(const Yaml intri, open_yaml(folder + "/intri.yml"));
  STGS_ASSIGN(const Yaml extri, open_yaml(folder + "/extri.yml"));
  SourceCapture capture;
  for (const cv::FileNode& node : intri.file["names"]) {
    const std::string name = node.isString() ? node.string() : std::to_string(int(node.real()));
    STGS_ASSIGN(SourceCamera camera, read_camera(folder, name, intri, extri));
    capture.cameras.push_back(std::move(camera));
  }
  if (capture.cameras.empty())
    return invalid_file("{}/intri.yml: 'names' lists no cameras", folder);
  return capture;
}

}  // namespace

Result<SourceCapture> load_easyvolcap(const std::string& folder) {
  try {
    return read_capture(folder);
  } catch (const cv::Exception& error) {
    return invalid_file("{}/intri.yml: 'names' is not a list of camera names: {}", folder,
                        error.err);
  }
}

}  // namespace stgs::encoder
