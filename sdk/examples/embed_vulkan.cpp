// SPDX-License-Identifier: Apache-2.0
// A scene in an application that draws with Vulkan: on its device, into its images, between its
// semaphores, composited by depth with its own geometry (app/compositor.h says how, and how well).
//
// usage: embed_vulkan SCENE.stgs SECONDS PICTURE.png [X Y Z HALF_EDGE]
//
// The cube stands in the middle of the scene unless told where. Exit code 5: the machine has no
// Vulkan device for it.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "app/compositor.h"

namespace {

struct DestroyScene {
  void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
};

void draw(int count, char** arguments) {
  app::Gpu gpu(app::vulkan_makers());
  stgs_scene* made = nullptr;
  if (stgs_scene_create(nullptr, &made) != STGS_OK) throw std::runtime_error("no memory");
  const std::unique_ptr<stgs_scene, DestroyScene> scene(made);
  app::must(stgs_scene_open(made, arguments[1]), made);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  app::must(stgs_scene_get_info(made, &info), made);
  stgs_view view = app::first_view(made);
  std::fill_n(view.background, 3, 0.0f);  // what is behind the scene is the application's
  app::Place place = app::middle_of(info, view);
  if (count == 8) {
    for (int i = 0; i < 3; ++i) place.centre[i] = std::strtof(arguments[4 + i], nullptr);
    place.half_edge = std::strtof(arguments[7], nullptr);
  }

  const app::Image picture =
      gpu.make_image(VK_FORMAT_R8G8B8A8_UNORM, view.width, view.height,
                     VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
                     VK_IMAGE_ASPECT_COLOR_BIT);
  app::Compositor compositor(gpu, picture.format, {{view.width, view.height}});
  compositor.draw(made, std::atof(arguments[2]), {view}, {{picture.image, picture.view}}, place);
  app::write_png(arguments[3], view.width, view.height,
                 gpu.read(picture, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 8) {
    std::fprintf(stderr, "usage: embed_vulkan SCENE.stgs SECONDS PICTURE.png [X Y Z HALF_EDGE]\n");
    return 1;
  }
  try {
    draw(argc, argv);
  } catch (const app::Unsupported& e) {
    std::fprintf(stderr, "embed_vulkan: %s\n", e.what());
    return 5;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "embed_vulkan: %s\n", e.what());
    return 4;
  }
  return 0;
}
