// SPDX-License-Identifier: Apache-2.0
#include "scene_capture.h"

#include <algorithm>

#include "stgs/encoder/windows.h"

namespace stgs::tools {

stgs_view view_of(const encoder::Camera& camera, const stgs_view& like) {
  const auto single = [](double v) { return static_cast<float>(v); };
  stgs_view view = like;
  std::transform(camera.rotation, camera.rotation + 9, view.rotation, single);
  std::transform(camera.translation, camera.translation + 3, view.translation, single);
  view.fx = single(camera.fx);
  view.fy = single(camera.fy);
  view.cx = single(camera.cx);
  view.cy = single(camera.cy);
  view.width = static_cast<std::uint32_t>(camera.width);
  view.height = static_cast<std::uint32_t>(camera.height);
  return view;
}

Result<encoder::Camera> camera_of(const stgs_view& start, const std::string& file) {
  StartCamera camera;
  std::copy_n(start.rotation, 9, camera.rotation);
  std::copy_n(start.translation, 3, camera.translation);
  camera.fx = start.fx;
  camera.fy = start.fy;
  camera.cx = start.cx;
  camera.cy = start.cy;
  camera.width = start.width;
  camera.height = start.height;
  return camera_of(camera, file);
}

Result<encoder::PreparedCapture> capture_of_scene(const encoder::PreparedCapture& capture,
                                                  const SceneFile& file) {
  auto info = sized<stgs_scene_info>();
  auto contents = sized<stgs_contents>();
  STGS_TRY(file.check(stgs_scene_get_info(file.get(), &info)));
  STGS_TRY(file.check(stgs_scene_get_contents(file.get(), &contents)));
  SceneMetadata metadata;
  metadata.frames = info.frames;
  if (contents.is_window != 0) {
    metadata.window = CaptureWindow{contents.window_first_frame, contents.capture_frames,
                                    contents.capture_id, contents.training_id};
  }
  return encoder::capture_for_scene(capture, metadata, file.name());
}

}  // namespace stgs::tools
