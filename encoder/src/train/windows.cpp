// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/windows.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "stgs/encoder/camera_json.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::ordered_json;

std::uint64_t hash_of(const Json& json) {
  const std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  return XXH3_64bits(text.data(), text.size());
}

// Returns a hash of the properties that captures must share for their scenes to belong together.
std::uint64_t capture_id(const PreparedCapture& capture) {
  Json json = {{"source", capture.source},
               {"first_frame", capture.first_frame},
               {"frames", capture.frames},
               {"time_base", {capture.time_base.numerator, capture.time_base.denominator}},
               {"scene", {capture.near_plane, capture.extent, capture.scene_radius}}};
  for (const Camera& camera : capture.cameras) json["cameras"].push_back(camera_to_json(camera));
  return hash_of(json);
}

// Returns whether the poses agree within float precision. The image sizes may differ, because the
// same capture may have been prepared at another scale.
bool has_same_pose(const Camera& camera, const StartCamera& start, double extent) {
  constexpr double kRounding = 1e-5;
  double length = extent;
  for (const double t : camera.translation) length = std::max(length, std::abs(t));
  for (int i = 0; i < 9; ++i) {
    if (std::abs(camera.rotation[i] - start.rotation[i]) > kRounding) return false;
  }
  for (int i = 0; i < 3; ++i) {
    if (std::abs(camera.translation[i] - start.translation[i]) > kRounding * length) return false;
  }
  return true;
}

}  // namespace

Result<PreparedCapture> extract_window(const PreparedCapture& capture, const FrameSpan& span) {
  if (span.begin < 0 || span.begin >= span.end || span.end > capture.frames) {
    return usage_error("{}: frames {}:{} are out of range (expected 0:{})", capture.folder,
                       span.begin, span.end, capture.frames);
  }
  PreparedCapture window = capture;
  window.window = CaptureWindow{static_cast<std::uint32_t>(span.begin),
                                static_cast<std::uint32_t>(capture.frames), capture_id(capture), 0};
  window.first_frame += span.begin;
  window.frames = span.size();
  return window;
}

Result<PreparedCapture> capture_for_scene(const PreparedCapture& capture,
                                          const SceneMetadata& scene, const std::string& name) {
  if (!scene.window) return capture;
  const auto begin = static_cast<int>(scene.window->first_frame);
  const FrameSpan span = {begin, begin + static_cast<int>(scene.frames)};
  Result<PreparedCapture> window = extract_window(capture, span);
  if (!window.ok() || window->window->capture != scene.window->capture) {
    return usage_error(
        "{}: window (frames {}:{}) of another capture than {}; use the capture that it was trained "
        "on",
        name, span.begin, span.end, capture.folder);
  }
  return window;
}

Status check_same_times(const PreparedCapture& covered, const SceneMetadata& scene,
                        const std::string& name) {
  if (static_cast<std::int64_t>(scene.frames) == covered.frames &&
      scene.time_base == covered.time_base) {
    return {};
  }
  return usage_error(
      "{}: {} frames of {}/{} s do not match {} with {} frames of {}/{} s; use the capture that "
      "the "
      "scene was trained on",
      name, scene.frames, scene.time_base.numerator, scene.time_base.denominator, covered.folder,
      covered.frames, covered.time_base.numerator, covered.time_base.denominator);
}

void warn_if_other_capture(const PreparedCapture& capture, const SceneMetadata& scene,
                           const std::string& name, const LogSink& log) {
  if (!log || !scene.start_camera) return;
  const bool known =
      std::any_of(capture.cameras.begin(), capture.cameras.end(), [&](const Camera& camera) {
        return has_same_pose(camera, *scene.start_camera, capture.extent);
      });
  if (known) return;
  log(1, fmt::format("{}: no camera of {} has the pose of the scene's start camera, so the scene "
                     "may be of another capture or calibration; use the prepared capture that it "
                     "was trained on",
                     name, capture.folder));
}

}  // namespace stgs::encoder
