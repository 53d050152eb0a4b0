// SPDX-License-Identifier: Apache-2.0
// A scene in a headset: both eyes drawn by one call of STGS into the application's images, laid
// over its geometry by depth (app/compositor.h) in the runtime's swapchains. The time at which the
// display will show a frame is the player's clock; what has not come by then is left out.
//
// usage: hello_openxr FILE|URL [FRAMES PREFIX [SCALE]]
//
// Plays the scene in a loop until the runtime ends the session or FRAMES were drawn, and then
// writes the last picture of each eye, PREFIX-left.png and PREFIX-right.png. SCALE (1): of the size
// that the runtime recommends. Exit code 5: there is no OpenXR runtime, headset or Vulkan device
// for it.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <thread>

#include "app/compositor.h"
#include "xr/eye_view.h"
#include "xr/session.h"

namespace {

struct Options {
  const char* place = nullptr;
  int frames = 0;  // 0: no end
  std::string prefix;
  float scale = 1;
};

struct DestroyPlayer {
  void operator()(stgs_player* player) const { stgs_player_destroy(player); }
};
using Player = std::unique_ptr<stgs_player, DestroyPlayer>;

// Plays, in a loop; `info` and `start` are what its scene says of itself.
Player open_player(const char* place, stgs_scene_info& info, stgs_view& start) {
  stgs_player* made = nullptr;
  if (stgs_player_create(nullptr, &made) != STGS_OK) throw std::runtime_error("no memory");
  Player player(made);
  app::must(stgs_player_open(made, place), made);
  app::must(stgs_player_wait_open(made), made);
  app::must(stgs_player_set_loop(made, 1), made);
  app::must(stgs_player_play(made), made);
  stgs_scene* const scene = stgs_player_scene(made);
  info.struct_size = sizeof info;
  app::must(stgs_scene_get_info(scene, &info), scene);
  start = app::first_view(scene);
  return player;
}

// The moment to draw for a time of the display's.
double moment_at(stgs_player* player, XrTime time) {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  app::must(stgs_player_update(player, 1e-9 * static_cast<double>(time), &status), player);
  return status.seconds;
}

VkExtent2D scaled(VkExtent2D size, float scale) {
  const auto side = [=](std::uint32_t full) {
    return std::max(1u, static_cast<std::uint32_t>(std::lround(scale * static_cast<float>(full))));
  };
  return {side(size.width), side(size.height)};
}

// Frames, and the display's time from the first to the last.
struct Timing {
  XrTime first = 0, last = 0;
  int drawn = 0, hidden = 0;

  void add(const xr::Frame& frame) {
    if (drawn == 0) first = frame.time;
    last = frame.time;
    ++drawn;
  }
  double pictures_a_second() const {
    return last > first ? 1e9 * (drawn - 1) / static_cast<double>(last - first) : 0;
  }
};

void play(const Options& options) {
  const xr::System system;
  app::Gpu gpu(system.makers());
  stgs_scene_info info{};
  stgs_view start{};
  const Player player = open_player(options.place, info, start);
  const xr::Anchor anchor = xr::anchor_at(start, info);
  const app::Place place = app::middle_of(info, start);
  const VkExtent2D size = scaled(system.recommended_size(), options.scale);
  xr::Session session(system, gpu, size);
  app::Compositor compositor(gpu, session.format(), {size, size});
  Timing timing;
  bool leaving = false;
  while (session.poll()) {
    if (!session.running()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));  // until an event
      continue;
    }
    const xr::Frame frame = session.begin_frame();
    if (frame.visible) {
      timing.add(frame);
      std::vector<stgs_view> views;
      for (const XrView& eye : frame.eyes) {
        views.push_back(xr::eye_view(eye, anchor, start, size.width, size.height));
      }
      const auto images = session.acquire();
      compositor.draw(stgs_player_scene(player.get()), moment_at(player.get(), frame.time), views,
                      {{images[0].image, images[0].view}, {images[1].image, images[1].view}},
                      place);
      if (timing.drawn == options.frames) {
        for (std::size_t i = 0; i < xr::kEyes; ++i) {
          const app::Image image{images[i].image, images[i].view, session.format(), size.width,
                                 size.height};
          app::write_png(options.prefix + (i == 0 ? "-left.png" : "-right.png"), size.width,
                         size.height, gpu.read(image, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL));
        }
      }
      session.release();
    } else {
      ++timing.hidden;
    }
    session.end_frame(frame);
    if (options.frames > 0 && timing.drawn >= options.frames && !leaving) {
      session.request_exit();
      leaving = true;
    }
  }
  std::printf("%u x %u an eye, %d frames drawn, %d not visible, %.1f a second, %s\n", size.width,
              size.height, timing.drawn, timing.hidden, timing.pictures_a_second(),
              session.has_been_focused() ? "was focused" : "never focused");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2 && argc != 4 && argc != 5) {
    std::fprintf(stderr, "usage: hello_openxr FILE|URL [FRAMES PREFIX [SCALE]]\n");
    return 1;
  }
  Options options;
  options.place = argv[1];
  if (argc > 3) {
    options.frames = std::atoi(argv[2]);
    options.prefix = argv[3];
  }
  if (argc > 4) options.scale = std::strtof(argv[4], nullptr);
  try {
    play(options);
  } catch (const app::Unsupported& e) {
    std::fprintf(stderr, "hello_openxr: %s\n", e.what());
    return 5;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "hello_openxr: %s\n", e.what());
    return 4;
  }
  return 0;
}
