// SPDX-License-Identifier: Apache-2.0
// Drawing on a device that is lent, into images of its owner, compared with the CPU renderer; with
// the validation layer where it is installed. Exit code 77: there is no device.
#include "vulkan_host.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>

#include "catch.h"
#include "catch_runner.h"
#include "scene_fixture.h"
#include "vulkan/features.h"
#include "vulkan/vulkan_renderer.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

namespace {

constexpr std::uint32_t kWidth = 160, kHeight = 96;
constexpr double kMoment = 0.97;
constexpr auto kReadable = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

std::unique_ptr<Timeline> timeline_over(const Scene& scene) {
  auto bytes = encode_scene(scene, WriteSettings{});
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  return Timeline::from_reader(std::move(*reader));
}

View view_of(std::uint32_t width = kWidth, std::uint32_t height = kHeight) {
  View view{};
  view.camera.rotation = math::rotation_of({0.99f, 0.02f, -0.05f, 0.03f});
  view.camera.translation = {0.1f, -0.05f, 0.2f};
  view.camera.width = static_cast<float>(width);
  view.camera.height = static_cast<float>(height);
  view.camera.fx = view.camera.fy = 0.9f * view.camera.width;
  view.camera.cx = 0.51f * view.camera.width;
  view.camera.cy = 0.48f * view.camera.height;
  view.camera.near_plane = 0.2f;
  view.background = {0.2f, 0.5f, 0.7f};
  return view;
}

Frame reference(Timeline& timeline, double seconds, const View& view) {
  std::vector<Frame> frames;
  check((*make_renderer("cpu"))->render(timeline, seconds, {view}, frames, nullptr));
  return std::move(frames[0]);
}

std::unique_ptr<VulkanRenderer> renderer_on(const VulkanHost& host, std::uint64_t instances = 0) {
  VulkanSettings settings;
  settings.initial_instances = instances;
  auto renderer = make_vulkan_renderer(host.device(), settings);
  check(renderer.status());
  return std::move(*renderer);
}

VulkanImage given(const HostImage& image) {
  VulkanImage out;
  out.image = image.image;
  out.format = image.format;
  out.width = image.width;
  out.height = image.height;
  out.final_layout = kReadable;
  return out;
}

VulkanSubmission into(const HostImage& image) {
  VulkanSubmission to;
  to.targets = {{given(image), {}}};
  return to;
}

float half(std::uint16_t bits) {
  const float magnitude = (bits >> 10 & 31) == 0
                              ? std::ldexp(static_cast<float>(bits & 1023), -24)
                              : std::ldexp(static_cast<float>((bits & 1023) | 1024),
                                           static_cast<int>(bits >> 10 & 31) - 25);
  return bits >> 15 ? -magnitude : magnitude;
}

struct Layout {
  VkFormat format;
  std::uint32_t bytes;  // of a pixel
  std::function<float(const std::uint8_t*, int)> channel;
};

template <typename T>
T number_at(const std::uint8_t* at) {
  T value;
  std::memcpy(&value, at, sizeof(value));
  return value;
}

std::vector<Layout> layouts() {
  const auto rgba8 = [](const std::uint8_t* p, int c) { return static_cast<float>(p[c]) / 255; };
  const auto bgra8 = [](const std::uint8_t* p, int c) {
    return static_cast<float>(p[c < 3 ? 2 - c : 3]) / 255;
  };
  const auto rgb10 = [](const std::uint8_t* p, int c) {
    const auto bits = number_at<std::uint32_t>(p) >> 10 * c;
    return c < 3 ? static_cast<float>(bits & 1023) / 1023 : static_cast<float>(bits & 3) / 3;
  };
  const auto rgba16 = [](const std::uint8_t* p, int c) {
    return half(number_at<std::uint16_t>(p + 2 * c));
  };
  const auto rgba32 = [](const std::uint8_t* p, int c) { return number_at<float>(p + 4 * c); };
  return {
      {VK_FORMAT_R8G8B8A8_UNORM, 4, rgba8},           {VK_FORMAT_R8G8B8A8_SRGB, 4, rgba8},
      {VK_FORMAT_B8G8R8A8_UNORM, 4, bgra8},           {VK_FORMAT_B8G8R8A8_SRGB, 4, bgra8},
      {VK_FORMAT_A2B10G10R10_UNORM_PACK32, 4, rgb10}, {VK_FORMAT_R16G16B16A16_SFLOAT, 8, rgba16},
      {VK_FORMAT_R32G32B32A32_SFLOAT, 16, rgba32}};
}

const Layout& layout_of(VkFormat format) {
  static const std::vector<Layout> all = layouts();
  return *std::find_if(all.begin(), all.end(), [=](const Layout& l) { return l.format == format; });
}

// dB, of the colours; of alpha the largest difference.
struct Difference {
  double psnr, alpha;
};
Difference difference(const Frame& expected, const std::vector<std::uint8_t>& found,
                      const Layout& layout) {
  const std::size_t pixels = expected.alpha.data.size();
  double squares = 0, alpha = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* at = found.data() + i * layout.bytes;
    for (int c = 0; c < 3; ++c) {
      // As all formats but the floats, whatever is beyond 1.
      const double want = std::clamp(expected.colour.plane(c)[i], 0.0f, 1.0f);
      const double off = std::clamp(layout.channel(at, c), 0.0f, 1.0f) - want;
      squares += off * off;
    }
    alpha = std::max<double>(alpha, std::abs(layout.channel(at, 3) - expected.alpha.data[i]));
  }
  return {-10 * std::log10(squares / static_cast<double>(3 * pixels) + 1e-20), alpha};
}

double psnr(const Frame& expected, VulkanHost& host, const HostImage& image) {
  const Layout& layout = layout_of(image.format);
  return difference(expected, host.read(image, kReadable, layout.bytes), layout).psnr;
}

// Made once: each takes a while under the validation layer.
VulkanHost& host() {
  static const std::unique_ptr<VulkanHost> made = VulkanHost::make(true);
  return *made;
}

}  // namespace

TEST_CASE("a device is taken to be made with what it was made with, and no more") {
  VulkanDevice lent = host().device();
  const VkPhysicalDevice gpu = lent.physical_device;
  const auto offered = vulkan_support(nullptr, lent.instance, lent.api_version, gpu);
  check(offered.status());
  CHECK(vulkan::enabled_features(lent).timeline_semaphores == offered->timeline_semaphores);
  CHECK(vulkan::enabled_features(lent).subgroup_size_control == offered->subgroup_size_control);
  lent.api_version = VK_API_VERSION_1_1;
  lent.extensions.clear();
  CHECK_FALSE(vulkan::enabled_features(lent).timeline_semaphores);
  CHECK_FALSE(vulkan::enabled_features(lent).subgroup_size_control);
  // Of the core: both of the two features of subgroups count, in either structure.
  VkPhysicalDeviceVulkan13Features core{};
  core.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
  VkPhysicalDeviceVulkan12Features before{};
  before.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  before.pNext = &core;
  VkPhysicalDeviceFeatures2 features{};
  features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  features.pNext = &before;
  lent.api_version = VK_API_VERSION_1_3;
  lent.features = &features;
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(gpu, &properties);
  const bool is_1_3 = properties.apiVersion >= VK_API_VERSION_1_3;
  before.timelineSemaphore = core.subgroupSizeControl = VK_TRUE;
  CHECK(vulkan::enabled_features(lent).timeline_semaphores);
  CHECK_FALSE(vulkan::enabled_features(lent).subgroup_size_control);
  core.computeFullSubgroups = VK_TRUE;
  CHECK(vulkan::enabled_features(lent).subgroup_size_control == is_1_3);
  lent.features = nullptr;
  CHECK_FALSE(vulkan::enabled_features(lent).timeline_semaphores);
}

TEST_CASE("a size of subgroups is asked for where the device was made so that it can be") {
  const VkPhysicalDevice gpu = host().device().physical_device;
  const vulkan::Features made = vulkan::enabled_features(host().device());
  VkPhysicalDeviceSubgroupSizeControlProperties sizes{};
  sizes.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_PROPERTIES;
  VkPhysicalDeviceProperties2 properties{};
  properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
  properties.pNext = &sizes;
  if (made.subgroup_size_control) vkGetPhysicalDeviceProperties2(gpu, &properties);
  const auto has = [&](std::uint32_t lanes) {
    return sizes.minSubgroupSize <= lanes && lanes <= sizes.maxSubgroupSize;
  };
  const bool can_be_asked =
      (sizes.requiredSubgroupSizeStages & VK_SHADER_STAGE_COMPUTE_BIT) != 0 && (has(32) || has(16));
  const vulkan::Subgroups with = vulkan::subgroups_of(gpu, made);
  CHECK(with.required == can_be_asked);
  if (can_be_asked) CHECK(with.lanes == (has(32) ? 32 : 16));
  CHECK_FALSE(vulkan::subgroups_of(gpu, {}).required);
}

TEST_CASE("images of every format have the CPU's picture") {
  const auto renderer = renderer_on(host());
  const auto timeline = timeline_over(random_scene(4000, 2, 60, 5));
  const Frame expected = reference(*timeline, kMoment, view_of());
  for (const Layout& layout : layouts()) {
    INFO("VkFormat " << layout.format);
    const HostImage image = host().make_image(layout.format, kWidth, kHeight);
    check(renderer->submit(*timeline, kMoment, {view_of()}, into(image)).status());
    check(renderer->wait());
    const auto d = difference(expected, host().read(image, kReadable, layout.bytes), layout);
    CHECK(d.psnr >= 50);
    CHECK(d.alpha <= (layout.format == VK_FORMAT_A2B10G10R10_UNORM_PACK32 ? 0.17 : 0.004));
    const VulkanFrame frame = *renderer->last_completed();
    CHECK(frame.complete);
    CHECK(frame.stats.splats > 0);
    CHECK(frame.stats.active >= frame.stats.splats);
  }
}

TEST_CASE("several views go to a layer and level of an image each, and their depth with them") {
  const auto renderer = renderer_on(host());
  const auto timeline = timeline_over(random_scene(3000, 1, 60, 6));
  std::vector<View> views = {view_of(), view_of(), view_of(kWidth / 2, kHeight / 2)};
  views[1].camera.translation.x += 0.3f;
  // Two eyes with frusta askew, one with a fovea, and a small one beside them.
  views[0].camera.cx += 14;
  views[1].camera.cx -= 14;
  views[1].fovea = Fovea{{kWidth / 3.0f, kHeight / 2.0f}, 40.0f};
  const HostImage colour = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight, 2, 2);
  const HostImage depth = host().make_image(VK_FORMAT_R32_SFLOAT, kWidth, kHeight);
  VulkanSubmission to;
  to.targets = {{given(colour), {}}, {given(colour), given(depth)}, {given(colour), {}}};
  to.targets[1].colour.layer = 1;
  to.targets[2].colour.level = 1;
  to.targets[2].colour.width /= 2;
  to.targets[2].colour.height /= 2;
  check(renderer->submit(*timeline, kMoment, views, to).status());
  const Layout& layout = layout_of(colour.format);
  const std::uint32_t places[][2] = {{0, 0}, {0, 1}, {1, 0}};
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto found = host().read(colour, kReadable, layout.bytes, places[i][0], places[i][1]);
    CHECK(difference(reference(*timeline, kMoment, views[i]), found, layout).psnr >= 50);
  }
  const Frame expected = reference(*timeline, kMoment, views[1]);
  const auto found = host().read(depth, kReadable, 4);
  std::size_t far = 0;
  for (std::size_t i = 0; i < expected.depth.data.size(); ++i) {
    const float want = expected.depth.data[i], got = number_at<float>(found.data() + 4 * i);
    far += !(std::abs(want - got) <= want / 255);
  }
  CHECK(far <= 2);
}

TEST_CASE("a frame waits for its semaphores, and its caller for nothing") {
  const auto renderer = renderer_on(host());
  const auto timeline = timeline_over(random_scene(2000, 0, 60, 7));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  check(renderer->submit(*timeline, 0.1, {view_of()}, into(image)).status());
  check(renderer->wait());
  const auto before = host().read(image, kReadable, 4);
  const VkSemaphore free = host().make_timeline(3), ready = host().make_timeline(0);
  VulkanSubmission to = into(image);
  to.targets[0].colour.initial_layout = kReadable;
  to.wait = {{free, 5}};
  to.signal = {{ready, 9}};
  const auto number = renderer->submit(*timeline, kMoment, {view_of()}, to);
  check(number.status());
  CHECK(*number == 2);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  CHECK(host().value_of(ready) == 0);
  CHECK(renderer->last_completed()->number == 1);
  host().signal(free, 5);
  check(renderer->wait());
  CHECK(host().value_of(ready) == 9);
  CHECK(renderer->last_completed()->number == 2);
  CHECK(psnr(reference(*timeline, kMoment, view_of()), host(), image) >= 50);
  CHECK(host().read(image, kReadable, 4) != before);
}

TEST_CASE("many frames on their way draw what each was asked for") {
  const auto renderer = renderer_on(host());
  const auto timeline = timeline_over(random_scene(3000, 1, 60, 8));
  std::vector<HostImage> images;
  for (std::uint64_t k = 0; k < 8; ++k) {
    // Larger ones meanwhile, for which frames need more room.
    const std::uint32_t width = kWidth + (k == 5 ? 200 : 0);
    images.push_back(host().make_image(VK_FORMAT_B8G8R8A8_UNORM, width, kHeight));
    const auto number = renderer->submit(*timeline, 0.2 * static_cast<double>(k),
                                         {view_of(width, kHeight)}, into(images.back()));
    check(number.status());
    CHECK(*number == k + 1);
    const std::uint64_t ended = renderer->last_completed()->number;
    CHECK(ended <= *number);
    CHECK(ended + VulkanRenderer::kMaxFramesInFlight >= *number);
  }
  for (std::size_t k = 0; k < images.size(); ++k) {
    INFO("frame " << k + 1);
    const View view = view_of(images[k].width, kHeight);
    CHECK(psnr(reference(*timeline, 0.2 * static_cast<double>(k), view), host(), images[k]) >= 50);
  }
  check(renderer->wait());
  CHECK(renderer->last_completed()->number == images.size());
  // draw() and read() go on beside it.
  std::vector<Frame> frames;
  check(renderer->render(*timeline, kMoment, {view_of()}, frames, nullptr));
  const Frame expected = reference(*timeline, kMoment, view_of());
  double squares = 0;
  for (std::size_t i = 0; i < expected.colour.data.size(); ++i) {
    squares += std::pow(expected.colour.data[i] - frames[0].colour.data[i], 2);
  }
  CHECK(squares / static_cast<double>(expected.colour.data.size()) < 1e-5);
}

TEST_CASE("segments come and go while frames that use them are on their way") {
  const auto renderer = renderer_on(host());
  const Scene scene = random_scene(6000, 1, 60, 21);
  const auto ample = timeline_over(scene);
  WriteSettings settings;
  settings.chunk_seconds = 0.3;
  auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  const auto tight = Timeline::from_reader(std::move(*reader), "the scene", 600'000);
  std::vector<HostImage> images;
  std::vector<double> moments;
  for (int k = 0, i = 11; k < 30; ++k, i = (i + 37) % 60) {
    moments.push_back(i / 30.0);
    images.push_back(host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight));
    check(renderer->submit(*tight, moments.back(), {view_of()}, into(images.back())).status());
  }
  check(renderer->wait());
  CHECK(renderer->last_completed()->stats.stored < scene.gaussians.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    INFO("moment " << moments[k]);
    CHECK(psnr(reference(*ample, moments[k], view_of()), host(), images[k]) >= 50);
  }
}

TEST_CASE(
    "a frame with too many splats in tiles lacks the farthest, says so, and the next has all") {
  const auto renderer = renderer_on(host(), 400);
  const auto timeline = timeline_over(random_scene(3000, 0, 60, 9));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  const Frame expected = reference(*timeline, kMoment, view_of());
  Frame empty = expected;
  for (int c = 0; c < 3; ++c) {
    const float background[] = {0.2f, 0.5f, 0.7f};
    std::fill_n(empty.colour.plane(c), kWidth * kHeight, background[c]);
  }
  double before = 0;
  for (int k = 0; k < 2; ++k) {
    check(renderer->submit(*timeline, kMoment, {view_of()}, into(image)).status());
    check(renderer->wait());
    CHECK(renderer->last_completed()->complete == (k == 1));
    const double now = psnr(expected, host(), image);
    if (k == 0) {
      // Not the background alone.
      CHECK(psnr(empty, host(), image) < 60);
      CHECK(now < 50);
      before = now;
    } else {
      CHECK(now >= 50);
      CHECK(now > before);
    }
  }
}

TEST_CASE("what a submission lacks is told, and nothing is submitted") {
  const auto renderer = renderer_on(host());
  const auto timeline = timeline_over(random_scene(200, 0, 60, 3));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  const HostImage bytes = host().make_image(VK_FORMAT_R8_UNORM, kWidth, kHeight);
  const auto refused = [&](const VulkanSubmission& to, StatusCode code, const char* word) {
    const auto number = renderer->submit(*timeline, kMoment, {view_of()}, to);
    INFO(number.status().message());
    CHECK(number.status().code() == code);
    CHECK(number.status().message().find(word) != std::string::npos);
  };
  refused({}, StatusCode::kUsage, "targets");
  VulkanSubmission to = into(image);
  to.targets[0].colour.image = VK_NULL_HANDLE;
  refused(to, StatusCode::kUsage, "missing");
  to = into(image);
  to.targets[0].colour.width += 1;
  refused(to, StatusCode::kUsage, "161x96");
  refused(into(bytes), StatusCode::kUsage, "format");
  to = into(image);
  to.targets[0].depth = given(image);
  refused(to, StatusCode::kUsage, "depth");
  to = into(image);
  to.targets[0].colour.final_layout = VK_IMAGE_LAYOUT_UNDEFINED;
  refused(to, StatusCode::kUsage, "layout");
  to = into(image);
  to.wait = {{VK_NULL_HANDLE, 1}};
  refused(to, StatusCode::kUsage, "semaphore");
  CHECK(renderer->submit(*timeline, NAN, {view_of()}, into(image)).status().code() ==
        StatusCode::kUsage);
  check(renderer->wait());
  CHECK(renderer->last_completed()->number == 0);
}

TEST_CASE("a device that cannot be used is refused with what it lacks") {
  const auto refused = [](const VulkanDevice& device, StatusCode code, const char* word) {
    const auto renderer = make_vulkan_renderer(device);
    INFO(renderer.status().message());
    CHECK(renderer.status().code() == code);
    CHECK(renderer.status().message().find(word) != std::string::npos);
  };
  refused({}, StatusCode::kUsage, "needs");
  VulkanDevice device = host().device();
  device.queue = VK_NULL_HANDLE;
  refused(device, StatusCode::kUsage, "queue");
  device = host().device();
  device.api_version = VK_API_VERSION_1_0;
  refused(device, StatusCode::kUnsupported, "1.1");
  device = host().device();
  device.queue_family = 99;
  refused(device, StatusCode::kUsage, "family 99");
  device = host().device();
  device.lock_queue = [] {};
  refused(device, StatusCode::kUsage, "lock_queue");
}

TEST_CASE("a device without timeline semaphores draws, and says so where they are asked for") {
  const auto other = VulkanHost::make(false);
  const auto renderer = renderer_on(*other);
  const auto timeline = timeline_over(random_scene(2000, 0, 60, 4));
  const HostImage image = other->make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  VulkanSubmission to = into(image);
  to.wait = {{reinterpret_cast<VkSemaphore>(0x1), 1}};
  const auto number = renderer->submit(*timeline, kMoment, {view_of()}, to);
  CHECK(number.status().code() == StatusCode::kUnsupported);
  CHECK(number.status().message().find("timelineSemaphore") != std::string::npos);
  check(renderer->submit(*timeline, kMoment, {view_of()}, into(image)).status());
  CHECK(psnr(reference(*timeline, kMoment, view_of()), *other, image) >= 50);
}

TEST_CASE("the queue is locked whenever it is used, and the device stays the caller's") {
  int locked = 0, uses = 0;
  VulkanDevice device = host().device();
  device.get_instance_proc_addr = vkGetInstanceProcAddr;
  device.lock_queue = [&] { ++locked, ++uses; };
  device.unlock_queue = [&] { --locked; };
  const auto timeline = timeline_over(random_scene(2000, 0, 60, 4));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  {
    auto renderer = make_vulkan_renderer(device);
    check(renderer.status());
    check((*renderer)->submit(*timeline, kMoment, {view_of()}, into(image)).status());
    CHECK(locked == 0);
    CHECK(uses >= 1);
  }
  CHECK(psnr(reference(*timeline, kMoment, view_of()), host(), image) >= 50);
}

int main(int argc, char** argv) {
  if (VulkanHost::make(true) == nullptr) {
    std::printf("skipped: there is no Vulkan device with timeline semaphores\n");
    return 77;
  }
  const int failed = stgs::testing::run_cases(argc, argv);
  for (const std::string& message : VulkanHost::messages()) std::printf("%s\n", message.c_str());
  return failed != 0 ? failed : static_cast<int>(!VulkanHost::messages().empty());
}
