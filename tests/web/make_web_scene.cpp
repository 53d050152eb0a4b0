// SPDX-License-Identifier: Apache-2.0
// Writes a random scene for the tests of the player for browsers, of 60 frames unless stated, or a
// random SOG model.
//
// usage: make_web_scene [--thin] FILE.stgs PRIMITIVES SH_DEGREE [NEAR [AUDIO [FRAMES]]]
//        make_web_scene FILE.sog PRIMITIVES SH_DEGREE
// --thin: band-limited splats, most of them smaller than a pixel; NEAR: of the near plane, scene
// units; AUDIO: location of its sound, which begins with it. Exit code 77: built without libwebp or
// libzip
#include <cstdlib>
#include <iostream>
#include <string_view>

#include "../fixtures/scene_fixture.h"
#ifdef STGS_HAS_SOG
#include "../fixtures/sog_fixture.h"
#endif

int main(int argc, char** argv) {
  const bool is_thin = argc > 1 && argv[1] == std::string_view("--thin");
  argv += is_thin ? 1 : 0;
  argc -= is_thin ? 1 : 0;
  if (argc < 4 || argc > 7) {
    std::cerr << "usage: make_web_scene [--thin] FILE.stgs PRIMITIVES SH_DEGREE [NEAR [AUDIO "
                 "[FRAMES]]]\n";
    return 1;
  }
  constexpr unsigned kSeed = 11;
  if (const std::string_view path = argv[1]; path.substr(path.rfind('.')) == ".sog") {
#ifdef STGS_HAS_SOG
    const int width = 64;  // of its images
    stgs::testing::random_sog(std::atoi(argv[2]), std::atoi(argv[3]), kSeed, width)
        .write_bundle(argv[1]);
    return 0;
#else
    return 77;
#endif
  }
  const auto frames =
      argc == 7 ? static_cast<std::uint32_t>(std::strtoul(argv[6], nullptr, 10)) : 60;
  stgs::Scene scene = stgs::testing::random_scene(std::strtoul(argv[2], nullptr, 10),
                                                  std::atoi(argv[3]), frames, kSeed);
  scene.metadata.title.clear();
  if (argc > 4) scene.metadata.near_plane = std::strtof(argv[4], nullptr);
  if (argc > 5) scene.metadata.audio = argv[5];
  // Large enough for many layers of splats, unless they are thin.
  for (float& s : scene.gaussians.log_scale) s += is_thin ? -1.8f : 1.2f;
  if (is_thin) scene.metadata.kernel = stgs::math::kBandLimited;
  stgs::WriteSettings settings;
  settings.profile = stgs::Profile::kQuantised;
  settings.chunk_seconds = 0.25;
  const stgs::Status status = stgs::write_scene(argv[1], scene, settings);
  if (!status.ok()) std::cerr << status.message() << "\n";
  return static_cast<int>(status.code());
}
