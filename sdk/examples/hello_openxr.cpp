// SPDX-License-Identifier: Apache-2.0
// A scene in a headset: one call renders both eyes into images of the application, which composites
// them by depth with its geometry (app/compositor.h) in the swapchains of the runtime. The player's
// clock is the predicted display time; data that has not arrived by then is missing from the frame.
//
// usage: hello_openxr FILE|URL [FRAMES PREFIX [SCALE]]
//
// Plays the scene in a loop until the runtime ends the session or FRAMES were rendered, then writes
// the last image of each eye, PREFIX-left.png and PREFIX-right.png. SCALE (default 1) multiplies
// the image size that the runtime recommends. Exit code 5: no OpenXR runtime, headset or suitable
// Vulkan device.
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
  const char* location = nullptr;
  int frames = 0;  // 0: unlimited
  std::string prefix;
  float scale = 1;
};

struct DestroyPlayer {
  void operator()(stgs_player* player) const { stgs_player_destroy(player); }
};
using Player = std::unique_ptr<stgs_player, DestroyPlayer>;

// Opens a player that plays in a loop; returns the metadata and the first view of its scene.
Player open_player(const char* location, stgs_scene_info& info, stgs_view& start) {
  stgs_player* created = nullptr;
  if (stgs_player_create(nullptr, &created) != STGS_OK) throw std::runtime_error("out of memory");
  Player player(created);
  app::check(stgs_player_open(created, location), created);
  app::check(stgs_player_wait_open(created), created);
  app::check(stgs_player_set_loop(created, 1), created);
  app::check(stgs_player_play(created), created);
  stgs_scene* const scene = stgs_player_scene(created);
  info.struct_size = sizeof info;
  app::check(stgs_scene_get_info(scene, &info), scene);
  start = app::first_view(scene);
  return player;
}

// Advances the player to a display time and returns the clip time to render.
double advance(stgs_player* player, XrTime time) {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  app::check(stgs_player_update(player, 1e-9 * static_cast<double>(time), &status), player);
  return status.seconds;
}

VkExtent2D scaled(VkExtent2D size, float scale) {
  const auto side = [=](std::uint32_t full) {
    return std::max(1u, static_cast<std::uint32_t>(std::lround(scale * static_cast<float>(full))));
  };
  return {side(size.width), side(size.height)};
}

// Number of frames, and display time from the first to the last.
struct Timing {
  XrTime first = 0, last = 0;
  int rendered = 0, hidden = 0;

  void add(const xr::Frame& frame) {
    if (rendered == 0) first = frame.time;
    last = frame.time;
    ++rendered;
  }
  double fps() const {
    return last > first ? 1e9 * (rendered - 1) / static_cast<double>(last - first) : 0;
  }
};

void play(const Options& options) {
  const xr::System system;
  app::Gpu gpu(system.device_factory());
  stgs_scene_info info{};
  stgs_view start{};
  const Player player = open_player(options.location, info, start);
  const xr::Anchor anchor = xr::anchor_at(start, info);
  const app::Placement cube = app::centre_of(info, start);
  const VkExtent2D size = scaled(system.recommended_size(), options.scale);
  xr::Session session(system, gpu, size);
  app::Compositor compositor(gpu, session.format(), {size, size});
  Timing timing;
  bool leaving = false;
  while (session.poll()) {
    if (!session.running()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));  // wait for an event
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
      compositor.render(stgs_player_scene(player.get()), advance(player.get(), frame.time), views,
                        {{images[0].image, images[0].view}, {images[1].image, images[1].view}},
                        cube);
      if (timing.rendered == options.frames) {
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
    if (options.frames > 0 && timing.rendered >= options.frames && !leaving) {
      session.request_exit();
      leaving = true;
    }
  }
  std::printf("%u x %u per eye, %d frames rendered, %d not visible, %.1f fps, %s\n", size.width,
              size.height, timing.rendered, timing.hidden, timing.fps(),
              session.has_been_focused() ? "was focused" : "never focused");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2 && argc != 4 && argc != 5) {
    std::fprintf(stderr, "usage: hello_openxr FILE|URL [FRAMES PREFIX [SCALE]]\n");
    return 1;
  }
  Options options;
  options.location = argv[1];
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
