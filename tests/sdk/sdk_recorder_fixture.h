// SPDX-License-Identifier: Apache-2.0
// Recorders of the C API, and the scenes that they write.
#pragma once

#include "sdk_encoder_fixture.h"

namespace stgs::testing {

inline stgs_record_settings record_settings() {
  stgs_record_settings settings;
  REQUIRE(stgs_record_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.quality = 100;
  settings.sync = 0;
  return settings;
}
inline RecorderPtr begin_recording(const std::string& path) {
  RecorderPtr recorder = make_recorder();
  const stgs_record_settings settings = record_settings();
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  return recorder;
}
inline std::string message_of(const RecorderPtr& recorder) {
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_recorder_error(recorder.get(), &error) == STGS_OK);
  return error.message;
}
inline stgs_recorder_status status_of(const RecorderPtr& recorder) {
  auto status = empty_output<stgs_recorder_status>();
  REQUIRE(stgs_recorder_get_status(recorder.get(), &status) == STGS_OK);
  return status;
}

inline ScenePtr open_path(const std::string& path) {
  ScenePtr scene = make_scene();
  REQUIRE(stgs_scene_open(scene.get(), path.c_str()) == STGS_OK);
  return scene;
}
inline stgs_scene_info info_of(const ScenePtr& scene) {
  auto info = empty_output<stgs_scene_info>();
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  return info;
}

}  // namespace stgs::testing
