// SPDX-License-Identifier: Apache-2.0
// Writes the scene for test_window.py and test_hello_openxr.py.
//
// usage: make_play_scene FILE.stgs
#include <cstdio>

#include "../fixtures/scene_fixture.h"

int main(int argc, char** argv) {
  using namespace stgs;
  if (argc != 2) {
    std::fprintf(stderr, "usage: make_play_scene FILE.stgs\n");
    return 1;
  }
  Scene scene = testing::random_scene(2000, 1, 90, 9);
  scene.metadata.title = "random scene";
  scene.metadata.background[0] = 0.2f;
  scene.metadata.background[2] = 0.5f;
  StartCamera start;
  start.width = 320;
  start.height = 240;
  start.fx = start.fy = 280;
  start.cx = 165;
  start.cy = 118;
  scene.metadata.start_camera = start;
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = 0.25;
  const Status status = write_scene(argv[1], scene, settings);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
