// SPDX-License-Identifier: Apache-2.0
#include "source_capture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <set>

#include "capture_files.h"
#include "natural_order.h"
#include "plural.h"
#include "stgs/encoder/protocol.h"
#include "stgs/format/json_text.h"
#include "stgs/format/text.h"
#include "timing_file.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

struct LayoutEntry {
  Layout layout;
  const char* evidence;  // files that identify the layout
};
// In the order of detection.
constexpr std::array<LayoutEntry, 6> kLayouts = {{
    {Layout::kPanoptic, "train_meta.json"},
    {Layout::kN3dv, "poses_bounds.npy"},
    {Layout::kEasyVolcap, "intri.yml and extri.yml"},
    {Layout::kNerfstudio, "transforms.json"},
    {Layout::kColmap, "cameras and images (.bin or .txt) in sparse/0, sparse or the folder itself"},
    {Layout::kVideos,
     "cameras.json, or at least two videos or image folders in videos/, images/ or the folder "
     "itself"},
}};

Result<bool> matches(Layout layout, const CaptureFolder& files) {
  const auto has = [&](const char* name) { return files.exists(files.path() + "/" + name); };
  switch (layout) {
    case Layout::kPanoptic:
      return has("train_meta.json");
    case Layout::kN3dv:
      return has("poses_bounds.npy");
    case Layout::kEasyVolcap:
      return has("intri.yml") && has("extri.yml");
    case Layout::kNerfstudio:
      return has("transforms.json");
    case Layout::kColmap:
      return !colmap_model_folder(files).empty();
    case Layout::kVideos: {
      if (has("cameras.json")) return true;
      STGS_ASSIGN(const std::vector<SourceCamera> cameras, find_cameras(files));
      return cameras.size() >= 2;
    }
    case Layout::kAuto:
      break;
  }
  return false;
}

Result<Layout> detect(const CaptureFolder& files) {
  std::string evidence;
  for (const LayoutEntry& entry : kLayouts) {
    STGS_ASSIGN(const bool found, matches(entry.layout, files));
    if (found) return entry.layout;
    if (!evidence.empty()) evidence += "; ";
    evidence += fmt::format("{} ({})", entry.evidence, layout_name(entry.layout));
  }
  STGS_ASSIGN(const std::vector<SourceCamera> cameras, find_cameras(files));
  STGS_TRY(check_camera_count(files.path(), cameras));
  return invalid_file("{}: unknown capture layout (see --layout); looked for {}", files.path(),
                      evidence);
}

Result<SourceCapture> load(Layout layout, const std::shared_ptr<const CaptureFolder>& files,
                           const PrepareSettings& settings, const ProgressSink& progress,
                           const LogSink& log) {
  switch (layout) {
    case Layout::kPanoptic:
      return load_panoptic(*files);
    case Layout::kN3dv:
      return load_n3dv(*files);
    case Layout::kEasyVolcap:
      return load_easyvolcap(*files);
    case Layout::kNerfstudio:
      return load_nerfstudio(*files, log);
    case Layout::kColmap:
      return load_colmap(*files);
    case Layout::kVideos:
      return load_videos(files, settings, progress, log);
    case Layout::kAuto:
      break;
  }
  return usage_error("{}: no layout selected", files->path());
}

// Replaces the rotation by the nearest rotation matrix. kInvalidFile if it is not close to one.
Status make_rigid(SourceCamera& camera, const std::string& folder) {
  const cv::Matx33d given(camera.rotation);
  cv::Matx33d u, vt;
  cv::Vec3d w;
  for (int i = 0; i < 9; ++i) {
    if (!std::isfinite(given.val[i])) w[0] = -1;
  }
  if (w[0] == 0) cv::SVD::compute(given, w, u, vt);
  const cv::Matx33d rotation = u * vt;
  const bool rigid =
      w[0] < 1.01 && w[2] > 0.99 && cv::determinant(rotation) > 0 &&
      std::isfinite(camera.translation[0] + camera.translation[1] + camera.translation[2]);
  if (!rigid) {
    return invalid_file(
        "{}: the pose of camera '{}' is not a rotation and a finite translation (expected a rigid "
        "world-to-camera transform)",
        folder, camera.name);
  }
  std::copy(rotation.val, rotation.val + 9, camera.rotation);
  return {};
}

// kInvalidFile if two cameras have one video or folder of images, if two entries of a table have
// one image, or if most frames are links to others.
Status check_distinct(const SourceCapture& capture) {
  const bool lists_images =
      capture.layout == Layout::kNerfstudio || capture.layout == Layout::kPanoptic;
  DistinctFiles known;
  FrameFiles frames;
  for (const SourceCamera& camera : capture.cameras) {
    std::vector<std::string> paths = {camera.video};
    if (camera.video.empty()) {
      paths = camera.images;
      if (!lists_images) paths = {fs::path(camera.images.front()).parent_path().string()};
    }
    const std::string where = fmt::format("{}: camera '{}'", capture.folder, camera.name);
    for (const std::string& path : paths) STGS_TRY(known.add(*capture.files, path, where));
    for (const std::string& path : camera.images) STGS_TRY(frames.add(*capture.files, path));
  }
  return frames.check(capture.folder);
}

}  // namespace

Status check_source(SourceCapture& capture, bool is_rig) {
  if (capture.cameras.empty()) return invalid_file("{}: no cameras found", capture.folder);
  STGS_TRY(check_camera_limit(capture.cameras.size(), capture.folder));
  std::set<std::string> names;
  for (SourceCamera& camera : capture.cameras) {
    const bool folder_name = !camera.name.empty() && camera.name.front() != '.' &&
                             camera.name.find('/') == std::string::npos &&
                             is_printable(camera.name);
    if (!folder_name) {
      return invalid_file("{}: camera name {} cannot be a folder name; rename the camera",
                          capture.folder, short_json(nlohmann::json(camera.name)));
    }
    STGS_TRY(check_frame_limit(camera.images.size(),
                               fmt::format("{}: camera '{}'", capture.folder, camera.name)));
    if (!is_utf8(camera.name)) {
      return invalid_file("{}: camera name '{}' is not valid UTF-8; rename its folder or video",
                          capture.folder, camera.name);
    }
    if (!names.insert(camera.name).second) {
      return invalid_file("{}: two cameras are named '{}'; rename one", capture.folder,
                          camera.name);
    }
    if (!is_rig && camera.video.empty() && camera.images.empty()) {
      return io_error("{}: no frames for camera '{}'", capture.folder, camera.name);
    }
    STGS_TRY(make_rigid(camera, capture.folder));
  }
  return is_rig ? Status() : check_distinct(capture);
}

namespace {

bool has_camera(const SourceCapture& capture, const std::string& name) {
  return std::any_of(capture.cameras.begin(), capture.cameras.end(),
                     [&](const SourceCamera& camera) { return camera.name == name; });
}

// Checks the names of the subfolders of masks/ or flow/. A name that matches no camera is a
// warning, or kInvalidFile if no name matches (`used` is false).
Status check_names(const SourceCapture& capture, const std::string& folder, bool used,
                   const LogSink& log) {
  if (!used) {
    return invalid_file(
        "{}: contains no folder for any camera (expected {}/{}/); name its folders after the "
        "cameras, or remove it",
        folder, folder, capture.cameras.front().name);
  }
  STGS_ASSIGN(const std::vector<std::string> folders, list_folders(*capture.files, folder));
  for (const std::string& path : folders) {
    const std::string name = fs::path(path).filename().string();
    if (!has_camera(capture, name)) {
      log(1, fmt::format("{}: ignored (no camera '{}')", path, name));
    }
  }
  return {};
}

// Attaches masks/CAMERA/, which exists for any layout and overrides the masks of the layout.
Status attach_masks(SourceCapture& capture, const LogSink& log) {
  const std::string folder = capture.folder + "/masks";
  if (!capture.files->is_folder(folder) || capture.masks_are_not_motion) return {};
  bool used = false;
  for (SourceCamera& camera : capture.cameras) {
    STGS_ASSIGN(const bool found, find_masks(*capture.files, folder, camera.name, camera));
    used |= found;
  }
  return check_names(capture, folder, used, log);
}

Status attach_flow(SourceCapture& capture, const LogSink& log) {
  const std::string folder = capture.folder + "/flow";
  if (!capture.files->is_folder(folder)) return {};
  capture.flow_folder = folder;
  bool used = false;
  for (const SourceCamera& camera : capture.cameras) {
    if (!capture.files->is_folder(folder + "/" + camera.name)) continue;
    used = true;
    if (camera.lens == LensModel::kPinhole) continue;
    return unsupported(
        "{}/{}: given flow needs undistorted frames, but the lens of camera '{}' distorts; "
        "undistort "
        "the capture first, or remove the folder to have flow computed",
        folder, camera.name, camera.name);
  }
  return check_names(capture, folder, used, log);
}

// Returns the cameras in the natural order of their names.
std::vector<SourceCamera*> by_name(SourceCapture& capture) {
  std::vector<SourceCamera*> sorted;
  for (SourceCamera& camera : capture.cameras) sorted.push_back(&camera);
  std::sort(sorted.begin(), sorted.end(), [](const SourceCamera* a, const SourceCamera* b) {
    return natural_less(a->name, b->name);
  });
  return sorted;
}

// Holds out the camera of a protocol, and no other.
Status choose_test_camera(SourceCapture& capture, const Protocol& protocol) {
  if (capture.cameras.size() <= protocol.test_camera) {
    return invalid_file("{}: has {}, but protocol {} holds out camera number {}", capture.folder,
                        plural(std::ssize(capture.cameras), "camera"), protocol.name,
                        protocol.test_camera + 1);
  }
  for (SourceCamera& camera : capture.cameras) camera.test = false;
  by_name(capture)[protocol.test_camera]->test = true;
  return {};
}

// Holds out the middle camera by name if the layout states no split and there are at least four.
void choose_test_camera(SourceCapture& capture, const LogSink& log) {
  constexpr std::size_t kMinCameras = 4;
  if (capture.split_known || capture.cameras.size() < kMinCameras) return;
  SourceCamera& middle = *by_name(capture)[capture.cameras.size() / 2];
  middle.test = true;
  log(2, fmt::format("{}: holding out camera '{}' as the test camera (change with --test-cameras)",
                     capture.folder, middle.name));
}

}  // namespace

Status check_camera_count(const std::string& folder, const std::vector<SourceCamera>& cameras) {
  if (cameras.size() != 1) return {};
  return invalid_file(
      "{}: only 1 camera ('{}'), but at least 2 cameras are needed; add synchronised views "
      "from other positions",
      folder, cameras.front().name);
}

std::string_view layout_name(Layout layout) {
  return kLayoutNames.at(static_cast<std::size_t>(layout));
}

namespace {

Result<SourceCapture> load_checked(const std::shared_ptr<const CaptureFolder>& files,
                                   const PrepareSettings& settings, const ProgressSink& progress,
                                   const LogSink& log) {
  const std::string& folder = files->path();
  Layout layout = settings.layout;
  if (layout == Layout::kAuto) {
    STGS_ASSIGN(layout, detect(*files));
    log(2, fmt::format("{}: detected layout '{}'", folder, layout_name(layout)));
  }
  Result<SourceCapture> capture = load(layout, files, settings, progress, log);
  if (!capture.ok()) return capture;
  capture->layout = layout;
  capture->folder = folder;
  capture->files = files;
  STGS_TRY(check_source(*capture, false));
  STGS_TRY(attach_masks(*capture, log));
  STGS_TRY(attach_flow(*capture, log));
  STGS_TRY(attach_timing(*capture));
  const bool own_split = settings.default_test_cameras && settings.test_cameras.empty();
  if (!settings.protocol.empty()) {
    const Protocol* protocol = find_protocol(settings.protocol);
    if (protocol == nullptr) return usage_error("unknown protocol '{}'", settings.protocol);
    if (!own_split) {
      return usage_error("protocol {} has a test camera of its own; name no others",
                         protocol->name);
    }
    STGS_TRY(choose_test_camera(*capture, *protocol));
  } else if (own_split) {
    choose_test_camera(*capture, log);
  }
  return capture;
}

}  // namespace

Result<SourceCapture> load_source(const std::string& folder, const PrepareSettings& settings,
                                  const ProgressSink& progress, const LogSink& log) {
  try {
    if (!fs::exists(folder)) {
      return io_error("{}: no such file or folder; name the folder with the videos or images",
                      folder);
    }
    if (!fs::is_directory(folder)) {
      return invalid_file("{}: is not a folder; name the folder with the videos or images", folder);
    }
    STGS_ASSIGN(const auto files, CaptureFolder::open(folder, settings.allow_outside));
    if (files->exists(folder + "/capture.json")) {
      return usage_error("{}: this is a prepared capture; use 'stgs train'", folder);
    }
    return load_checked(files, settings, progress, log);
  } catch (const cv::Exception& error) {  // its what() has several lines
    return invalid_file("{}: cannot read the capture: {}", folder, error.err);
  } catch (const std::exception& error) {
    return Status(code_of(error),
                  fmt::format("{}: cannot read the capture: {}", folder, error.what()));
  }
}

}  // namespace stgs::encoder
