// SPDX-License-Identifier: Apache-2.0
#include "camera_file.h"

#include <algorithm>
#include <memory>
#include <string_view>

#include "standard_streams.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/camera.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/text.h"

namespace stgs::tools {
namespace {

constexpr std::uint64_t kMaxBytes = 1 << 20;

Result<std::string> read_text(const std::string& path) {
  if (is_standard_input(path)) {
    STGS_ASSIGN(const auto bytes, read_standard_input(kMaxBytes, "expected a camera file"));
    return std::string(bytes.begin(), bytes.end());
  }
  const Result<std::unique_ptr<ByteSource>> file = open_file(path);
  if (!file.ok()) {
    std::string_view why = file.status().message();  // "PATH: ..."
    why.remove_prefix(std::min(path.size() + 2, why.size()));
    constexpr std::string_view kCannot = "cannot open: ";
    if (why.starts_with(kCannot)) why.remove_prefix(kCannot.size());
    return io_error("{}: cannot open camera file: {}", path, why);
  }
  const std::uint64_t size = (*file)->size();
  if (size > kMaxBytes) {
    return invalid_file("{}: a camera file of {} bytes (expected at most {})", path, size,
                        kMaxBytes);
  }
  std::string text(static_cast<std::size_t>(size), '\0');
  STGS_TRY((*file)->read(0, {reinterpret_cast<std::uint8_t*>(text.data()), text.size()}));
  return text;
}

}  // namespace

Result<encoder::Camera> read_camera(const std::string& path) {
  STGS_ASSIGN(const std::string text, read_text(path));
  return encoder::parse_camera(text, path);
}

Json camera_json(const encoder::Camera& camera) {
  return encoder::camera_to_json(camera);
}

Result<encoder::Camera> camera_of(const StartCamera& start, const std::string& file) {
  const std::string name = file + ": start camera";
  // Before the conversion to int.
  if (start.width > kMaxImageSide || start.height > kMaxImageSide) {
    return invalid_file("{}: {}x{} pixels is too large (at most {} per side)", name, start.width,
                        start.height, kMaxImageSide);
  }
  encoder::Camera camera;
  camera.name = "start";
  camera.width = static_cast<int>(start.width);
  camera.height = static_cast<int>(start.height);
  camera.fx = start.fx;
  camera.fy = start.fy;
  camera.cx = start.cx;
  camera.cy = start.cy;
  std::copy(start.rotation, start.rotation + 9, camera.rotation);
  std::copy(start.translation, start.translation + 3, camera.translation);
  STGS_TRY(encoder::check_camera(camera, name));
  return camera;
}

encoder::Camera fitted(encoder::Camera camera, Size size) {
  const double x = static_cast<double>(size.width) / camera.width;
  const double y = static_cast<double>(size.height) / camera.height;
  camera.fx *= std::min(x, y);
  camera.fy *= std::min(x, y);
  camera.cx *= x;
  camera.cy *= y;
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

encoder::Camera resized(encoder::Camera camera, Size size) {
  const double x = static_cast<double>(size.width) / camera.width;
  const double y = static_cast<double>(size.height) / camera.height;
  camera.fx *= x;
  camera.cx *= x;
  camera.fy *= y;
  camera.cy *= y;
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

Result<std::vector<encoder::Camera>> choose_cameras(const encoder::PreparedCapture& capture,
                                                    const std::string& which) {
  std::vector<encoder::Camera> chosen;
  if (which == "all" || which == "test" || which == "train") {
    for (const encoder::Camera& camera : capture.cameras) {
      if (which == "all" || camera.test == (which == "test")) chosen.push_back(camera);
    }
    if (chosen.empty()) {
      return usage_error("{}: the capture has no {} cameras; use camera names, or 'all'",
                         capture.folder, which);
    }
    return chosen;
  }
  std::vector<std::string> names;
  for (const encoder::Camera& camera : capture.cameras) names.push_back(camera.name);
  for (const std::string& name : split_list(which)) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      return usage_error("{}: no camera '{}'; the cameras are {}", capture.folder, name,
                         fmt::format("{}", fmt::join(names, ", ")));
    }
    if (std::any_of(chosen.begin(), chosen.end(),
                    [&name](const encoder::Camera& camera) { return camera.name == name; })) {
      return usage_error("camera '{}' is named twice; name it once", name);
    }
    chosen.push_back(capture.cameras[static_cast<std::size_t>(found - names.begin())]);
  }
  if (chosen.empty())
    return usage_error("no camera is selected; use test, train, all, or camera names");
  return chosen;
}

}  // namespace stgs::tools
