// SPDX-License-Identifier: Apache-2.0
// Opens a scene while its data is still arriving, from a file or a URL, seeks to a time, waits
// until it is complete, and writes a PPM image.
//
// usage: player SCENE.stgs|URL SECONDS IMAGE.ppm
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "stgs/stgs.hpp"

namespace {

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

// The work of an application in each frame, except for rendering.
stgs_player_status tick(stgs::Player& player) {
  const stgs_player_status status = player.update(now());
  while (const auto event = player.next_event()) {
    if (!event->message.empty()) std::fprintf(stderr, "%s\n", event->message.c_str());
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return status;
}

void write_ppm(const char* path, const std::vector<std::uint8_t>& rgba, const stgs_view& view) {
  std::ofstream file(path, std::ios::binary);
  file << "P6\n" << view.width << " " << view.height << "\n255\n";
  for (std::size_t i = 0; i < rgba.size(); i += 4) {
    file.write(reinterpret_cast<const char*>(&rgba[i]), 3);
  }
  if (!file.flush()) throw std::runtime_error(std::string(path) + ": cannot write the image");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: player SCENE.stgs|URL SECONDS IMAGE.ppm\n");
    return 1;
  }
  try {
    stgs::Player player;
    stgs::Renderer renderer;
    player.open(argv[1]);
    player.wait_open();  // throws if opening failed; a viewer would show its window meanwhile
    player.pause();      // a growing recording starts by following its edge
    player.seek(std::atof(argv[2]));
    stgs_player_status status{};
    do {
      status = tick(player);
    } while (status.is_complete == 0);
    const stgs_view view = player.scene().first_view();
    write_ppm(argv[3], renderer.render_rgba8(player.scene(), status.seconds, view), view);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
