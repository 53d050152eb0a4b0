// SPDX-License-Identifier: Apache-2.0
// Fragments of a recording, identical in every process.
#pragma once

#include "scene_fixture.h"
#include "stgs/format/scene_recorder.h"

namespace stgs::testing {

inline constexpr std::uint32_t kFragmentFrames = 10;

// The primitives of fragment i, which covers frames [10 i, 10 i + 10); times count from
// its first frame.
inline Gaussians4D make_fragment(std::uint32_t i, std::size_t primitives = 60, int sh_degree = 1) {
  Gaussians4D set = random_scene(primitives, sh_degree, kFragmentFrames, 100 + i).gaussians;
  for (float& o : set.opacity_logit) o = std::abs(o);  // all are visible
  return set;
}

inline SceneMetadata recording_metadata() {
  SceneMetadata metadata;
  metadata.time_base = {1, 30};
  metadata.generator = "test";
  metadata.title = "a recording";
  return metadata;
}

inline RecordSettings recording_settings(Profile profile = Profile::kLossless) {
  RecordSettings settings;
  settings.write.profile = profile;
  settings.write.chunk_seconds = 0.1;
  settings.sync = false;
  return settings;
}

}  // namespace stgs::testing
