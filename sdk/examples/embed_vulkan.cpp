// SPDX-License-Identifier: Apache-2.0
// A scene in a Vulkan application: rendered on its device, into its images, synchronised by its
// semaphores, and composited by depth with its own geometry (see app/compositor.h).
//
// usage: embed_vulkan SCENE.stgs SECONDS IMAGE.png [X Y Z HALF_EDGE]
//
// X Y Z HALF_EDGE cube the cube; the default is the centre of the scene. Exit code 5: no suitable
// Vulkan device.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "app/compositor.h"

namespace {

struct DestroyScene {
  void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
};

void render(int count, char** arguments) {
  app::Gpu gpu(app::vulkan_factory());
  stgs_scene* created = nullptr;
  if (stgs_scene_create(nullptr, &created) != STGS_OK) throw std::runtime_error("out of memory");
  const std::unique_ptr<stgs_scene, DestroyScene> scene(created);
  app::check(stgs_scene_open(created, arguments[1]), created);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  app::check(stgs_scene_get_info(created, &info), created);
  stgs_view view = app::first_view(created);
  std::fill_n(view.background, 3, 0.0f);  // the application renders the background
  app::Placement cube = app::centre_of(info, view);
  if (count == 8) {
    for (int i = 0; i < 3; ++i) cube.centre[i] = std::strtof(arguments[4 + i], nullptr);
    cube.half_edge = std::strtof(arguments[7], nullptr);
  }

  const app::Image image =
      gpu.create_image(VK_FORMAT_R8G8B8A8_UNORM, view.width, view.height,
                       VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
                       VK_IMAGE_ASPECT_COLOR_BIT);
  app::Compositor compositor(gpu, image.format, {{view.width, view.height}});
  compositor.render(created, std::atof(arguments[2]), {view}, {{image.image, image.view}}, cube);
  app::write_png(arguments[3], view.width, view.height,
                 gpu.read(image, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 8) {
    std::fprintf(stderr, "usage: embed_vulkan SCENE.stgs SECONDS IMAGE.png [X Y Z HALF_EDGE]\n");
    return 1;
  }
  try {
    render(argc, argv);
  } catch (const app::Unsupported& e) {
    std::fprintf(stderr, "embed_vulkan: %s\n", e.what());
    return 5;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "embed_vulkan: %s\n", e.what());
    return 4;
  }
  return 0;
}
