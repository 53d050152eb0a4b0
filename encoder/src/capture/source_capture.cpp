// SPDX-License-Identifier: Apache-2.0
#include "source_capture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <set>

#include "capture_files.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

struct LayoutEntry {
  Layout layout;
  const char* name;
  const char* looked_for;  // what the layout is recognised by
};
// In the order in which a folder is tried.
constexpr std::array<LayoutEntry, 2> kLayouts = {{
    {Layout::kPanoptic, "panoptic", "train_meta.json"},
    {Layout::kN3dv, "n3dv", "poses_bounds.npy"},
}};

bool recognised(Layout layout, const std::string& folder) {
  const auto has = [&](const char* name) { return fs::exists(folder + "/" + name); };
  switch (layout) {
    case Layout::kPanoptic:
      return has("train_meta.json");
    case Layout::kN3dv:
      return has("poses_bounds.npy");
    default:
      return false;
  }
}

Result<Layout> detect(const std::string& folder) {
  std::string looked_for;
  for (const LayoutEntry& entry : kLayouts) {
    if (recognised(entry.layout, folder)) return entry.layout;
    looked_for += fmt::format("\n  {}: {}", entry.name, entry.looked_for);
  }
  return usage_error("{}: is not a capture of a known layout. Looked for:{}", folder, looked_for);
}

Result<SourceCapture> load(Layout layout, const std::string& folder, const LogSink& log) {
  switch (layout) {
    case Layout::kPanoptic:
      return load_panoptic(folder, log);
    case Layout::kN3dv:
      return load_n3dv(folder);
    default:
      return unsupported("{}: no loader", layout_name(layout));
  }
}

// Refuses what is no rotation, and takes the nearest one for what nearly is.
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
    return invalid_file("{}: the pose of camera '{}' is not a rotation and a translation", folder,
                        camera.name);
  }
  std::copy(rotation.val, rotation.val + 9, camera.rotation);
  return {};
}

Status check(SourceCapture& capture) {
  if (capture.cameras.empty()) return invalid_file("{}: has no cameras", capture.folder);
  std::set<std::string> names;
  for (SourceCamera& camera : capture.cameras) {
    const bool folder_name = !camera.name.empty() && camera.name.front() != '.' &&
                             camera.name.find('/') == std::string::npos;
    if (!folder_name) {
      return invalid_file("{}: '{}' cannot be a camera's folder", capture.folder, camera.name);
    }
    if (!names.insert(camera.name).second) {
      return invalid_file("{}: has two cameras '{}'", capture.folder, camera.name);
    }
    if (camera.video.empty() && camera.pictures.empty()) {
      return io_error("{}: camera '{}' has no frames", capture.folder, camera.name);
    }
    STGS_TRY(make_rigid(camera, capture.folder));
  }
  return {};
}

}  // namespace

const char* layout_name(Layout layout) {
  for (const LayoutEntry& entry : kLayouts) {
    if (entry.layout == layout) return entry.name;
  }
  return "auto";
}

Result<Layout> layout_from_name(const std::string& name) {
  if (name == "auto") return Layout::kAuto;
  std::string known = "auto";
  for (const LayoutEntry& entry : kLayouts) {
    if (name == entry.name) return entry.layout;
    known += fmt::format(", {}", entry.name);
  }
  return usage_error("'{}' is not a layout; known are {}", name, known);
}

Result<SourceCapture> load_source(const std::string& folder, const PrepareSettings& settings,
                                  const ProgressSink& progress, const LogSink& log) {
  (void)progress;
  if (!fs::is_directory(folder)) return io_error("{}: is not a folder", folder);
  Layout layout = settings.layout;
  if (layout == Layout::kAuto) {
    STGS_ASSIGN(layout, detect(folder));
    log(2, fmt::format("{}: recognised as {}", folder, layout_name(layout)));
  }
  Result<SourceCapture> capture = load(layout, folder, log);
  if (!capture.ok()) return capture;
  capture->layout = layout;
  capture->folder = folder;
  if (fs::is_directory(folder + "/flow")) capture->flow_folder = folder + "/flow";
  STGS_TRY(check(*capture));
  return capture;
}

}  // namespace stgs::encoder
