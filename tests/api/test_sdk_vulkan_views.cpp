// SPDX-License-Identifier: Apache-2.0
// Views and structs of the C interface on a Vulkan device: foveae, and other versions of the
// header.
#include "sdk_vulkan_fixture.h"

// After volk, which wants to be the first of Vulkan's headers.
#include "struct_sizes.h"

namespace stgs::testing {

TEST_CASE("a device too draws whole where the eye looks, and nearly so elsewhere", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  stgs_view views[2] = {start_view(scene.get()), start_view(scene.get())};
  std::vector<HostImage> images;
  std::vector<stgs_vulkan_target> targets;
  for (stgs_view& view : views) {
    REQUIRE(stgs_view_resize(&view, 4 * kSdkWidth, 4 * kSdkHeight) == STGS_OK);
    images.push_back(rgba8_of(host(), view));
    targets.push_back(into(images.back()));
  }
  views[1].fovea_x = 100;
  views[1].fovea_y = 80;
  views[1].fovea_radius = 50;
  const stgs_vulkan_frame frame = frame_of(views, targets.data(), 2);
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  check_foveated(host().read(images[0], kReadable, 4), host().read(images[1], kReadable, 4),
                 views[1]);
}

TEST_CASE("the structs for Vulkan are taken and written as other versions have them", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = rgba8_of(host(), view);
  const auto submit = [&](const stgs_vulkan_frame* frame) {
    const stgs_result result =
        stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, frame, nullptr);
    REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
    return result;
  };
  const stgs_vulkan_target target = into(image);
  check_taken("stgs_vulkan_frame", frame_of(&view, &target, 1), offsetof(stgs_vulkan_frame, wait),
              submit);
  check_taken("stgs_vulkan_target", target, offsetof(stgs_vulkan_target, depth),
              [&](const stgs_vulkan_target* given) {
                const stgs_vulkan_frame frame = frame_of(&view, given, 1);
                return submit(&frame);
              });
  const stgs_vulkan_device device = device_of(host());
  check_taken("stgs_vulkan_device", device, offsetof(stgs_vulkan_device, lock_queue),
              [&](const stgs_vulkan_device* given) {
                stgs_renderer* made = nullptr;
                const stgs_result result = stgs_vulkan_renderer_create(given, nullptr, &made);
                stgs_renderer_destroy(made);
                return result;
              });
  check_given<stgs_vulkan_support>("stgs_vulkan_support", [&](stgs_vulkan_support* support) {
    return stgs_vulkan_get_support(&device, support);
  });
  check_given<stgs_vulkan_progress>("stgs_vulkan_progress", [&](stgs_vulkan_progress* progress) {
    return stgs_vulkan_get_progress(renderer.get(), progress);
  });
  CHECK(sized_structs(STGS_SDK_HEADERS "/stgs_vulkan.h") ==
        std::set<std::string>{"stgs_vulkan_device", "stgs_vulkan_frame", "stgs_vulkan_progress",
                              "stgs_vulkan_support", "stgs_vulkan_target"});
}

}  // namespace stgs::testing
