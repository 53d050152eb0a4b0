// SPDX-License-Identifier: Apache-2.0
// Writes a random scene, of 60 frames unless stated.
//
// usage: make_web_scene FILE.stgs PRIMITIVES SH_DEGREE [NEAR [AUDIO [FRAMES]]]
// NEAR: of the near plane, scene units; AUDIO: location of its sound, which begins with it
#include <cstdlib>
#include <iostream>

#include "../fixtures/scene_fixture.h"

int main(int argc, char** argv) {
  if (argc < 4 || argc > 7) {
    std::cerr << "usage: make_web_scene FILE.stgs PRIMITIVES SH_DEGREE [NEAR [AUDIO [FRAMES]]]\n";
    return 1;
  }
  constexpr unsigned kSeed = 11;
  const auto frames =
      argc == 7 ? static_cast<std::uint32_t>(std::strtoul(argv[6], nullptr, 10)) : 60;
  stgs::Scene scene = stgs::testing::random_scene(std::strtoul(argv[2], nullptr, 10),
                                                  std::atoi(argv[3]), frames, kSeed);
  scene.metadata.title.clear();
  if (argc > 4) scene.metadata.near_plane = std::strtof(argv[4], nullptr);
  if (argc > 5) scene.metadata.audio = argv[5];
  // Large enough for many layers of splats.
  for (float& s : scene.gaussians.log_scale) s += 1.2f;
  stgs::WriteSettings settings;
  settings.profile = stgs::Profile::kQuantised;
  settings.chunk_seconds = 0.25;
  const stgs::Status status = stgs::write_scene(argv[1], scene, settings);
  if (!status.ok()) std::cerr << status.message() << "\n";
  return static_cast<int>(status.code());
}
