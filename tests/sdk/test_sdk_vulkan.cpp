// SPDX-License-Identifier: Apache-2.0
// The C API on a Vulkan device of the application, compared with its own CPU renderer. Uses the
// validation layer if it is installed. Exits with code 77 if there is no device.
#include "sdk_vulkan_fixture.h"

// After volk.h, which must precede other Vulkan headers.
#include <chrono>
#include <cstring>
#include <thread>

namespace stgs::testing {

TEST_CASE("the support query reports the features of a physical device", "[sdk]") {
  stgs_vulkan_device device;
  REQUIRE(stgs_vulkan_device_defaults(&device, sizeof device) == STGS_OK);
  stgs_vulkan_support support{};
  support.struct_size = sizeof support;
  CHECK(stgs_vulkan_get_support(&device, &support) == STGS_ERROR_ARGUMENT);
  device.instance = host().device().instance;
  device.physical_device = host().device().physical_device;
  CHECK(stgs_vulkan_get_support(&device, &support) == STGS_ERROR_UNSUPPORTED);
  device.api_version = VK_API_VERSION_1_2;
  REQUIRE(stgs_vulkan_get_support(&device, &support) == STGS_OK);
  CHECK(support.can_render == 1);
  CHECK(support.timeline_semaphores == 1);
  CHECK(support.subgroup_size_control == (host().controls_subgroup_sizes() ? 1 : 0));
  CHECK(std::string(support.missing_features).empty());
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device.physical_device, &properties);
  const bool is_cpu = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
  CHECK(support.device_rank >= 1);
  CHECK((support.device_rank == 1) == is_cpu);
  support.struct_size = 1;
  CHECK(stgs_vulkan_get_support(&device, &support) == STGS_ERROR_STRUCT_SIZE);
}

TEST_CASE("four views render into colour and depth images of the application", "[sdk]") {
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
    view.cx += 5 * static_cast<float>(i);  // off-centre frusta, as of stereo views
    REQUIRE(stgs_view_resize(&view, 64 + 8 * static_cast<std::uint32_t>(i), 48) == STGS_OK);
    images.push_back(make_rgba8_image(host(), view));
    targets.push_back(target_of(images[i]));
  }
  const HostImage depth = host().make_image(VK_FORMAT_R32_SFLOAT, views[2].width, 48);
  targets[2].depth = target_of(depth).colour;
  const stgs_vulkan_frame frame = frame_of(views.data(), targets.data(), 4);
  std::uint64_t number = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, &number) == STGS_OK);
  CHECK(number == 1);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  for (std::size_t i = 0; i < views.size(); ++i) {
    INFO("view " << i);
    CHECK(psnr_against_cpu(scene.get(), kTime, views[i], host(), images[i]) >= 50);
  }
  std::vector<float> expected(std::size_t{views[2].width} * 48), rendered(expected.size());
  stgs_image reference = empty_image();
  reference.depth = {expected.data(), 0, expected.size() * sizeof(float)};
  REQUIRE(stgs_render(cpu_renderer().get(), scene.get(), kTime, &views[2], &reference, 1) ==
          STGS_OK);
  const auto bytes = host().read(depth, kFinalLayout, 4);
  std::memcpy(rendered.data(), bytes.data(), bytes.size());
  int wrong = 0, visible = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    wrong += std::abs(rendered[i] - expected[i]) > expected[i] / 255;
    visible += expected[i] > 0;
  }
  CHECK(wrong <= 2);
  CHECK(visible > 1000);
  const stgs_vulkan_progress progress = progress_of(renderer.get());
  CHECK(progress.number == 1);
  CHECK(progress.complete == 1);
  CHECK(progress.splats > 0);
  CHECK(progress.active_primitives > 0);
  CHECK(progress.pending_primitives ==
        0);  // a scene that is not playing uploads everything at once
  // Drivers with timestamps measure the steps, one after the other, within the whole.
  const double steps = progress.slice_ms + progress.bin_ms + progress.blend_ms;
  CHECK((progress.blend_ms > 0) == (progress.device_ms > 0));
  CHECK(steps <= progress.device_ms * (1 + 1e-9));
}

TEST_CASE("a frame waits for timeline semaphores of the application and signals them", "[sdk]") {
  const auto file = sdk_file();
  ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = make_rgba8_image(host(), view);
  stgs_vulkan_target target = target_of(image);
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  // The first submission uploads the scene and may block; the next one must not.
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), 0.9, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  const auto before = host().read(image, kFinalLayout, 4);
  const stgs_vulkan_semaphore wait{host().make_timeline(3), 5};
  const stgs_vulkan_semaphore signal{host().make_timeline(0), 9};
  target.colour.initial_layout = kFinalLayout;
  frame.wait = &wait;
  frame.signal = &signal;
  frame.wait_count = frame.signal_count = 1;
  std::uint64_t number = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, &number) == STGS_OK);
  CHECK(number == 2);
  // The structs and the scene are no longer needed after the submission.
  frame = {};
  target = {};
  const auto expected = render_rgba8(cpu_renderer().get(), scene.get(), kTime, view);
  scene.reset();
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  CHECK(host().value_of(signal.semaphore) == 0);
  CHECK(progress_of(renderer.get()).number == 1);
  host().signal(wait.semaphore, 5);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  CHECK(host().value_of(signal.semaphore) == 9);
  CHECK(progress_of(renderer.get()).number == 2);
  const auto after = host().read(image, kFinalLayout, 4);
  CHECK(psnr(expected, after) >= 50);
  CHECK(psnr(before, after) < 50);
}

TEST_CASE("the scene of a player renders into images of the application", "[sdk]") {
  const auto file = sdk_file();
  stgs_player* player = nullptr;
  REQUIRE(stgs_player_create(nullptr, &player) == STGS_OK);
  const std::unique_ptr<stgs_player, void (*)(stgs_player*)> owner(player, stgs_player_destroy);
  REQUIRE(stgs_player_open_memory(player, file.data(), file.size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player) == STGS_OK);
  REQUIRE(stgs_player_seek(player, kTime) == STGS_OK);
  stgs_player_status status{};
  status.struct_size = sizeof status;
  for (double now = 0; status.is_complete == 0; now += 0.01) {
    REQUIRE(stgs_player_update(player, now, &status) == STGS_OK);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  const RendererPtr renderer = renderer_on(device_of(host()));
  stgs_scene* const scene = stgs_player_scene(player);
  const stgs_view view = start_view(scene);
  const HostImage image = make_rgba8_image(host(), view);
  const stgs_vulkan_target target = target_of(image);
  const stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene, status.seconds, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  const ScenePtr reference = open_scene(file);
  CHECK(psnr_against_cpu(reference.get(), kTime, view, host(), image) >= 50);
}

TEST_CASE("a device without timeline semaphores renders, and its application waits", "[sdk]") {
  const auto other = VulkanHost::make(false);
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(*other, false));
  const stgs_view view = start_view(scene.get());
  const HostImage image = make_rgba8_image(*other, view);
  const stgs_vulkan_target target = target_of(image);
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  const stgs_vulkan_semaphore semaphore{reinterpret_cast<VkSemaphore>(0x1), 1};
  frame.wait = &semaphore;
  frame.wait_count = 1;
  CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, nullptr) ==
        STGS_ERROR_UNSUPPORTED);
  CHECK(std::string(error_of(renderer.get()).message).find("timelineSemaphore") !=
        std::string::npos);
  frame.wait_count = 0;
  REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, nullptr) == STGS_OK);
  REQUIRE(stgs_vulkan_wait(renderer.get()) == STGS_OK);
  CHECK(psnr_against_cpu(scene.get(), kTime, view, *other, image) >= 50);
}

TEST_CASE("a renderer on an application's device also renders to memory, and locks the queue",
          "[sdk]") {
  struct QueueLock {
    int depth = 0, count = 0;
  } lock;
  stgs_vulkan_device device = device_of(host());
  device.get_instance_proc_addr = vkGetInstanceProcAddr;
  device.lock_queue = [](void* user) {
    ++static_cast<QueueLock*>(user)->depth;
    ++static_cast<QueueLock*>(user)->count;
  };
  device.unlock_queue = [](void* user) { --static_cast<QueueLock*>(user)->depth; };
  device.queue_user = &lock;
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const stgs_view view = start_view(scene.get());
  const HostImage image = make_rgba8_image(host(), view);
  {
    const RendererPtr renderer = renderer_on(device);
    const auto expected = render_rgba8(cpu_renderer().get(), scene.get(), kTime, view);
    CHECK(psnr(render_rgba8(renderer.get(), scene.get(), kTime, view), expected) >= 50);
    const stgs_vulkan_target target = target_of(image);
    const stgs_vulkan_frame frame = frame_of(&view, &target, 1);
    REQUIRE(stgs_vulkan_submit(renderer.get(), scene.get(), 0.9, &frame, nullptr) == STGS_OK);
    CHECK(lock.depth == 0);
    CHECK(lock.count >= 2);
  }
  // Destroying the renderer waits for the frame and leaves the device usable.
  CHECK(psnr_against_cpu(scene.get(), 0.9, view, host(), image) >= 50);
}

TEST_CASE("an invalid frame is rejected with its cause, and nothing is submitted", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = renderer_on(device_of(host()));
  const stgs_view view = start_view(scene.get());
  const HostImage image = make_rgba8_image(host(), view);
  const HostImage bytes = host().make_image(VK_FORMAT_R8_UNORM, view.width, view.height);
  const stgs_vulkan_target target = target_of(image);
  std::uint64_t number = 77;
  const auto check_rejected = [&](const stgs_vulkan_frame& frame, const char* cause,
                                  stgs_result expected = STGS_ERROR_ARGUMENT) {
    CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), kTime, &frame, &number) == expected);
    const std::string message = error_of(renderer.get()).message;
    INFO(message);
    CHECK(message.find(cause) != std::string::npos);
  };
  check_rejected(frame_of(&view, &target, 0), "views");
  check_rejected(frame_of(&view, &target, 5), "views");
  check_rejected(frame_of(nullptr, &target, 1), "NULL");
  stgs_vulkan_frame frame = frame_of(&view, &target, 1);
  frame.wait_count = 1;
  check_rejected(frame, "semaphores");
  const stgs_vulkan_semaphore none{};
  frame.wait = &none;
  check_rejected(frame, "semaphore");
  frame = frame_of(&view, &target, 1);
  frame.struct_size = 8;
  check_rejected(frame, "struct_size", STGS_ERROR_STRUCT_SIZE);
  stgs_vulkan_target other = target;
  other.colour.width += 1;
  check_rejected(frame_of(&view, &other, 1), "65x48");
  other = target_of(bytes);
  check_rejected(frame_of(&view, &other, 1), "format");
  other = target;
  other.colour.image = VK_NULL_HANDLE;
  check_rejected(frame_of(&view, &other, 1), "missing");
  other = target;
  other.depth = target.colour;
  check_rejected(frame_of(&view, &other, 1), "depth");
  stgs_view wrong = view;
  wrong.fx = -1;
  check_rejected(frame_of(&wrong, &target, 1), "fx");
  frame = frame_of(&view, &target, 1);
  CHECK(stgs_vulkan_submit(renderer.get(), scene.get(), NAN, &frame, &number) ==
        STGS_ERROR_ARGUMENT);
  CHECK(stgs_vulkan_submit(renderer.get(), nullptr, 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  const ScenePtr closed = make_scene();
  CHECK(stgs_vulkan_submit(renderer.get(), closed.get(), 0, &frame, &number) == STGS_ERROR_STATE);
  CHECK(stgs_vulkan_submit(nullptr, scene.get(), 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  CHECK(number == 77);
  CHECK(progress_of(renderer.get()).number == 0);
  // A renderer without an application's device cannot submit frames.
  const RendererPtr cpu = cpu_renderer();
  CHECK(stgs_vulkan_submit(cpu.get(), scene.get(), 0, &frame, &number) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(error_of(cpu.get()).message).find("stgs_vulkan_renderer_create") !=
        std::string::npos);
  CHECK(stgs_vulkan_wait(cpu.get()) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("an unusable device is rejected with its cause", "[sdk]") {
  std::string message;
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.log = [](void* user, stgs_log_level, const char* text) {
    *static_cast<std::string*>(user) = text;
  };
  settings.log_user = &message;
  const auto check_rejected = [&](const stgs_vulkan_device& device, stgs_result result,
                                  const char* cause) {
    stgs_renderer* renderer = reinterpret_cast<stgs_renderer*>(0x1);
    CHECK(stgs_vulkan_renderer_create(&device, &settings, &renderer) == result);
    CHECK(renderer == nullptr);
    INFO(message);
    CHECK(message.find(cause) != std::string::npos);
  };
  const stgs_vulkan_device good = device_of(host());
  stgs_vulkan_device device = good;
  device.queue = VK_NULL_HANDLE;
  check_rejected(device, STGS_ERROR_ARGUMENT, "queue");
  device = good;
  device.api_version = VK_API_VERSION_1_0;
  check_rejected(device, STGS_ERROR_UNSUPPORTED, "1.1");
  device = good;
  device.queue_family = 99;
  check_rejected(device, STGS_ERROR_ARGUMENT, "family 99");
  device = good;
  device.lock_queue = [](void*) {};
  check_rejected(device, STGS_ERROR_ARGUMENT, "lock_queue");
  device = good;
  device.struct_size = 0;
  check_rejected(device, STGS_ERROR_STRUCT_SIZE, "struct_size");
  settings.backend = STGS_BACKEND_CPU;
  check_rejected(good, STGS_ERROR_ARGUMENT, "Vulkan device");
}

}  // namespace stgs::testing

int main(int argc, char** argv) {
  return stgs::testing::run_vulkan_cases(argc, argv);
}
