// SPDX-License-Identifier: Apache-2.0
// The C interface on a Vulkan device of the application's, compared with its own pictures of the
// processor; with the validation layer where it is installed. Exit code 77: there is no device.
#include "catch_runner.h"
#include "sdk_vulkan_fixture.h"

// After volk, which wants to be the first of Vulkan's headers.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <thread>

namespace stgs::testing {

TEST_CASE("what a device is good for is told before it is made", "[sdk]") {
  stgs_vulkan_device asked;
  REQUIRE(stgs_vulkan_device_defaults(&asked, sizeof asked) == STGS_OK);
  stgs_vulkan_support support{};
  support.struct_size = sizeof support;
  CHECK(stgs_vulkan_get_support(&asked, &support) == STGS_ERROR_ARGUMENT);
  asked.instance = host().device().instance;
  asked.physical_device = host().device().physical_device;
  CHECK(stgs_vulkan_get_support(&asked, &support) == STGS_ERROR_UNSUPPORTED);
  asked.api_version = VK_API_VERSION_1_2;
  REQUIRE(stgs_vulkan_get_support(&asked, &support) == STGS_OK);
  CHECK(support.can_render == 1);
  CHECK(support.timeline_semaphores == 1);
  CHECK(support.subgroup_size_control == (host().controls_subgroup_sizes() ? 1 : 0));
  CHECK(std::string(support.missing_features).empty());
  support.struct_size = 1;
  CHECK(stgs_vulkan_get_support(&asked, &support) == STGS_ERROR_STRUCT_SIZE);
}

TEST_CASE("four views of a moment go to images of the application's, and depth with them",
          "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  stgs_backend backend = STGS_BACKEND_AUTO;
  REQUIRE(stgs_renderer_get_backend(renderer.get(), &backend) == STGS_OK);
  CHECK(backend == STGS_BACKEND_VULKAN);
  std::vector<stgs_view> views(4, start_view(scene.get()));
  std::vector<stgs_vulkan_target> targets;
  std::vector<HostImage> images;
  for (std::size_t i = 0; i < views.size(); ++i) {
    stgs_view& view = views[i];
    view.translation[0] = 0.1f * static_cast<float>(i);
    view.cx += 5 * static_cast<float>(i);  // frusta askew, as of eyes
    REQUIRE(stgs_view_resize(&view, 64 + 8 * static_cast<std::uint32_t>(i), 48) == STGS_OK);
    images.push_back(rgba8_of(host(), view));
    targets.push_back(into(images[i]));
  }
  const HostImage depth = host().make_image(VK_FORMAT_R32_SFLOAT, views[2].width, 48);
  targets[2].depth = into(depth).colour;
  const stgs_vulkan_frame frame = frame_of(views.data(), targets.data(), 4);
  std::uint64_t number = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, &number) == STGS_OK);
  CHECK(number == 1);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  for (std::size_t i = 0; i < views.size(); ++i) {
    INFO("view " << i);
    CHECK(psnr_of(scene.get(), kMoment, views[i], host(), images[i]) >= 50);
  }
  std::vector<float> expected(std::size_t{views[2].width} * 48), found(expected.size());
  stgs_image picture = empty_picture();
  picture.depth = {expected.data(), 0, expected.size() * sizeof(float)};
  REQUIRE(stgs_render(cpu_renderer().get(), scene.get(), kMoment, &views[2], &picture, 1) ==
          STGS_OK);
  const auto bytes = host().read(depth, kReadable, 4);
  std::memcpy(found.data(), bytes.data(), bytes.size());
  int far = 0, seen = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    far += std::abs(found[i] - expected[i]) > expected[i] / 255;
    seen += expected[i] > 0;
  }
  CHECK(far <= 2);
  CHECK(seen > 1000);
  const stgs_vulkan_progress progress = progress_of(renderer.get());
  CHECK(progress.number == 1);
  CHECK(progress.complete == 1);
  CHECK(progress.splats > 0);
  CHECK(progress.active_primitives > 0);
}

TEST_CASE("a frame waits for the application's timeline semaphores and signals them", "[sdk]") {
  const auto file = sdk_file();
  ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = rgba8_of(host(), view);
  stgs_vulkan_target target = into(image);
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  // What it brings to the device first, it may wait for.
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), 0.9, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  const auto before = host().read(image, kReadable, 4);
  const stgs_vulkan_semaphore wait{host().make_timeline(3), 5};
  const stgs_vulkan_semaphore signal{host().make_timeline(0), 9};
  target.colour.initial_layout = kReadable;
  frame.wait = &wait;
  frame.signal = &signal;
  frame.wait_count = frame.signal_count = 1;
  std::uint64_t number = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, &number) == STGS_OK);
  CHECK(number == 2);
  // Neither the structs nor the scene are needed any more.
  frame = {};
  target = {};
  const auto expected = draw_rgba8(cpu_renderer().get(), scene.get(), kMoment, view);
  scene.reset();
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  CHECK(host().value_of(signal.semaphore) == 0);
  CHECK(progress_of(renderer.get()).number == 1);
  host().signal(wait.semaphore, 5);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  CHECK(host().value_of(signal.semaphore) == 9);
  CHECK(progress_of(renderer.get()).number == 2);
  const auto after = host().read(image, kReadable, 4);
  CHECK(psnr(expected, after) >= 50);
  CHECK(psnr(before, after) < 50);
}

TEST_CASE("a player's scene goes into the application's images", "[sdk]") {
  const auto file = sdk_file();
  stgs_player* made = nullptr;
  REQUIRE(stgs_player_create(nullptr, &made) == STGS_OK);
  const std::unique_ptr<stgs_player, void (*)(stgs_player*)> player(made, stgs_player_destroy);
  REQUIRE(stgs_player_open_memory(made, file.data(), file.size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(made) == STGS_OK);
  REQUIRE(stgs_player_seek(made, kMoment) == STGS_OK);
  stgs_player_status status{};
  status.struct_size = sizeof status;
  for (double now = 0; status.is_complete == 0; now += 0.01) {
    REQUIRE(stgs_player_update(made, now, &status) == STGS_OK);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  const RendererPtr renderer = renderer_on(device_of(host()));
  stgs_scene* const scene = stgs_player_scene(made);
  const stgs_view view = start_view(scene);
  const HostImage image = rgba8_of(host(), view);
  const stgs_vulkan_target target = into(image);
  const stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene, status.seconds, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  const ScenePtr whole = open_scene(file);
  CHECK(psnr_of(whole.get(), kMoment, view, host(), image) >= 50);
}

TEST_CASE("without timeline semaphores a device draws, and its application waits", "[sdk]") {
  const auto other = VulkanHost::make(false);
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(*other, false));
  const stgs_view view = start_view(scene.get());
  const HostImage image = rgba8_of(*other, view);
  const stgs_vulkan_target target = into(image);
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  const stgs_vulkan_semaphore semaphore{reinterpret_cast<VkSemaphore>(0x1), 1};
  frame.wait = &semaphore;
  frame.wait_count = 1;
  CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, nullptr) ==
        STGS_ERROR_UNSUPPORTED);
  CHECK(std::string(error_of(renderer.get()).message).find("timelineSemaphore") !=
        std::string::npos);
  frame.wait_count = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  CHECK(psnr_of(scene.get(), kMoment, view, *other, image) >= 50);
}

TEST_CASE("a renderer on a lent device draws to memory too, and locks its queue", "[sdk]") {
  struct Uses {
    int locked = 0, count = 0;
  } uses;
  stgs_vulkan_device device = device_of(host());
  device.get_instance_proc_addr = vkGetInstanceProcAddr;
  device.lock_queue = [](void* user) {
    ++static_cast<Uses*>(user)->locked;
    ++static_cast<Uses*>(user)->count;
  };
  device.unlock_queue = [](void* user) { --static_cast<Uses*>(user)->locked; };
  device.queue_user = &uses;
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const stgs_view view = start_view(scene.get());
  const HostImage image = rgba8_of(host(), view);
  {
    const RendererPtr renderer = renderer_on(device);
    const auto expected = draw_rgba8(cpu_renderer().get(), scene.get(), kMoment, view);
    CHECK(psnr(draw_rgba8(renderer.get(), scene.get(), kMoment, view), expected) >= 50);
    const stgs_vulkan_target target = into(image);
    const stgs_vulkan_frame frame = frame_of(&view, &target, 1);
    REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), 0.9, &frame, nullptr) == STGS_OK);
    CHECK(uses.locked == 0);
    CHECK(uses.count >= 2);
  }
  // The renderer's end has waited for the frame, and left the device alone.
  CHECK(psnr_of(scene.get(), 0.9, view, host(), image) >= 50);
}

TEST_CASE("what a frame lacks is told, and nothing is submitted", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = rgba8_of(host(), view);
  const HostImage bytes = host().make_image(VK_FORMAT_R8_UNORM, view.width, view.height);
  const stgs_vulkan_target target = into(image);
  std::uint64_t number = 77;
  const auto refused = [&](const stgs_vulkan_frame& frame, const char* word,
                           stgs_result expected = STGS_ERROR_ARGUMENT) {
    CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), kMoment, &frame, &number) == expected);
    const std::string message = error_of(renderer.get()).message;
    INFO(message);
    CHECK(message.find(word) != std::string::npos);
  };
  refused(frame_of(&view, &target, 0), "views");
  refused(frame_of(&view, &target, 5), "views");
  refused(frame_of(nullptr, &target, 1), "NULL");
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  frame.wait_count = 1;
  refused(frame, "semaphores");
  const stgs_vulkan_semaphore none{};
  frame.wait = &none;
  refused(frame, "semaphore");
  frame = frame_of(&view, &target, 1);
  frame.struct_size = 8;
  refused(frame, "struct_size", STGS_ERROR_STRUCT_SIZE);
  stgs_vulkan_target other = target;
  other.colour.width += 1;
  refused(frame_of(&view, &other, 1), "65x48");
  other = into(bytes);
  refused(frame_of(&view, &other, 1), "format");
  other = target;
  other.colour.image = VK_NULL_HANDLE;
  refused(frame_of(&view, &other, 1), "missing");
  other = target;
  other.depth = target.colour;
  refused(frame_of(&view, &other, 1), "depth");
  stgs_view wrong = view;
  wrong.fx = -1;
  refused(frame_of(&wrong, &target, 1), "fx");
  frame = frame_of(&view, &target, 1);
  CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), NAN, &frame, &number) ==
        STGS_ERROR_ARGUMENT);
  CHECK(stgs_vulkan_submit(renderer.get(), nullptr, 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  const ScenePtr closed = make_scene();
  CHECK(stgs_vulkan_submit(renderer.get(), closed.get(), 0, &frame, &number) == STGS_ERROR_STATE);
  CHECK(stgs_vulkan_submit(nullptr, scene.get(), 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  CHECK(number == 77);
  CHECK(progress_of(renderer.get()).number == 0);
  // Nor by a renderer that has no such device.
  const RendererPtr cpu = cpu_renderer();
  CHECK(stgs_vulkan_submit(cpu.get(), scene.get(), 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(error_of(cpu.get()).message).find("stgs_vulkan_renderer_create") !=
        std::string::npos);
  CHECK(stgs_vulkan_wait(cpu.get()) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("a device that cannot be lent is refused with what it lacks", "[sdk]") {
  std::string told;
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.log = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) = message;
  };
  settings.log_user = &told;
  const auto refused = [&](const stgs_vulkan_device& device, stgs_result result, const char* word) {
    stgs_renderer* renderer = reinterpret_cast<stgs_renderer*>(0x1);
    CHECK(stgs_vulkan_renderer_create(&device, &settings, &renderer) == result);
    CHECK(renderer == nullptr);
    INFO(told);
    CHECK(told.find(word) != std::string::npos);
  };
  const stgs_vulkan_device good = device_of(host());
  stgs_vulkan_device device = good;
  device.queue = VK_NULL_HANDLE;
  refused(device, STGS_ERROR_ARGUMENT, "queue");
  device = good;
  device.api_version = VK_API_VERSION_1_0;
  refused(device, STGS_ERROR_UNSUPPORTED, "1.1");
  device = good;
  device.queue_family = 99;
  refused(device, STGS_ERROR_ARGUMENT, "family 99");
  device = good;
  device.lock_queue = [](void*) {};
  refused(device, STGS_ERROR_ARGUMENT, "lock_queue");
  device = good;
  device.struct_size = 0;
  refused(device, STGS_ERROR_STRUCT_SIZE, "struct_size");
  settings.backend = STGS_BACKEND_CPU;
  refused(good, STGS_ERROR_ARGUMENT, "Vulkan device");
}

}  // namespace stgs::testing

int main(int argc, char** argv) {
  using stgs::testing::VulkanHost;
  if (VulkanHost::make(true) == nullptr) {
    std::printf("skipped: there is no Vulkan device with timeline semaphores\n");
    return 77;
  }
  const int failed = stgs::testing::run_cases(argc, argv);
  for (const std::string& message : VulkanHost::messages()) std::printf("%s\n", message.c_str());
  return failed != 0 ? failed : static_cast<int>(!VulkanHost::messages().empty());
}
