// SPDX-License-Identifier: Apache-2.0
// The C API on a Vulkan device: foveated views, and structs of older and newer headers.
#include "sdk_vulkan_fixture.h"

// After volk.h, which must precede other Vulkan headers.
#include "struct_sizes.h"

namespace stgs::testing {

TEST_CASE("a foveated image on a device is identical within the fovea and close outside it",
          "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  stgs_view views[2] = {start_view(scene.get()), start_view(scene.get())};
  std::vector<HostImage> images;
  std::vector<stgs_vulkan_target> targets;
  for (stgs_view& view : views) {
    REQUIRE(stgs_view_resize(&view, 4 * kSdkWidth, 4 * kSdkHeight) == STGS_OK);
    images.push_back(make_rgba8_image(host(), view));
    targets.push_back(target_of(images.back()));
  }
  views[1].fovea_x = 100;
  views[1].fovea_y = 80;
  views[1].fovea_radius = 50;
  const stgs_vulkan_frame frame = frame_of(views, targets.data(), 2);
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  check_foveated(host().read(images[0], kFinalLayout, 4), host().read(images[1], kFinalLayout, 4),
                 views[1]);
}

TEST_CASE("the Vulkan functions accept structs of older and newer headers", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = make_rgba8_image(host(), view);
  const auto submit = [&](const stgs_vulkan_frame* frame) {
    const stgs_result result =
        stgs_vulkan_submit(renderer.get(), scene.get(), kTime, frame, nullptr);
    REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
    return result;
  };
  const stgs_vulkan_target target = target_of(image);
  check_input_struct("stgs_vulkan_frame", frame_of(&view, &target, 1),
                     offsetof(stgs_vulkan_frame, wait), submit);
  check_input_struct("stgs_vulkan_target", target, offsetof(stgs_vulkan_target, depth),
                     [&](const stgs_vulkan_target* passed) {
                       const stgs_vulkan_frame frame = frame_of(&view, passed, 1);
                       return submit(&frame);
                     });
  const stgs_vulkan_device device = device_of(host());
  check_input_struct("stgs_vulkan_device", device, offsetof(stgs_vulkan_device, lock_queue),
                     [&](const stgs_vulkan_device* passed) {
                       stgs_renderer* created = nullptr;
                       const stgs_result result =
                           stgs_vulkan_renderer_create(passed, nullptr, &created);
                       stgs_renderer_destroy(created);
                       return result;
                     });
  check_output_struct<stgs_vulkan_support>(
      "stgs_vulkan_support",
      [&](stgs_vulkan_support* support) { return stgs_vulkan_get_support(&device, support); });
  check_output_struct<stgs_vulkan_progress>(
      "stgs_vulkan_progress", [&](stgs_vulkan_progress* progress) {
        return stgs_vulkan_get_progress(renderer.get(), progress);
      });
  CHECK(sized_structs(STGS_SDK_HEADERS "/stgs_vulkan.h") ==
        std::set<std::string>{"stgs_vulkan_device", "stgs_vulkan_frame", "stgs_vulkan_progress",
                              "stgs_vulkan_support", "stgs_vulkan_target"});
}

}  // namespace stgs::testing
