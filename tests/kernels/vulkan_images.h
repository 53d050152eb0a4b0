// SPDX-License-Identifier: Apache-2.0
// Views, images and comparisons shared by the tests of rendering on a borrowed device.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <vector>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "vulkan/vulkan_renderer.h"
#include "vulkan_host.h"

namespace stgs::testing {

inline constexpr std::uint32_t kWidth = 160, kHeight = 96;
inline constexpr double kSeconds = 0.97;
inline constexpr auto kReadable = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;

inline void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

inline std::unique_ptr<player::Timeline> make_timeline(const Scene& scene) {
  auto bytes = encode_scene(scene, WriteSettings{});
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  return player::Timeline::from_reader(std::move(*reader));
}

inline player::View make_view(std::uint32_t width = kWidth, std::uint32_t height = kHeight) {
  player::View view{};
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

inline player::Frame render_on_cpu(player::Timeline& timeline, double seconds,
                                   const player::View& view) {
  std::vector<player::Frame> frames;
  check((*player::make_renderer("cpu"))->render(timeline, seconds, {view}, frames, nullptr));
  return std::move(frames[0]);
}

inline std::unique_ptr<player::VulkanRenderer> renderer_on(const VulkanHost& host,
                                                           std::uint64_t instances = 0) {
  player::VulkanSettings settings;
  settings.initial_instances = instances;
  auto renderer = player::make_vulkan_renderer(host.device(), settings);
  check(renderer.status());
  return std::move(*renderer);
}

inline player::VulkanImage target_image(const HostImage& image) {
  player::VulkanImage out;
  out.image = image.image;
  out.format = image.format;
  out.width = image.width;
  out.height = image.height;
  out.final_layout = kReadable;
  return out;
}

inline player::VulkanSubmission submission_to(const HostImage& image) {
  player::VulkanSubmission submission;
  submission.targets = {{target_image(image), {}}};
  return submission;
}

inline float half_to_float(std::uint16_t bits) {
  const float magnitude = (bits >> 10 & 31) == 0
                              ? std::ldexp(static_cast<float>(bits & 1023), -24)
                              : std::ldexp(static_cast<float>((bits & 1023) | 1024),
                                           static_cast<int>(bits >> 10 & 31) - 25);
  return bits >> 15 ? -magnitude : magnitude;
}

struct PixelLayout {
  VkFormat format;
  std::uint32_t bytes;  // per pixel
  std::function<float(const std::uint8_t*, int)> channel;
};

template <typename T>
T load(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(value));
  return value;
}

inline std::vector<PixelLayout> pixel_layouts() {
  const auto rgba8 = [](const std::uint8_t* p, int c) { return static_cast<float>(p[c]) / 255; };
  const auto bgra8 = [](const std::uint8_t* p, int c) {
    return static_cast<float>(p[c < 3 ? 2 - c : 3]) / 255;
  };
  const auto rgb10 = [](const std::uint8_t* p, int c) {
    const auto bits = load<std::uint32_t>(p) >> 10 * c;
    return c < 3 ? static_cast<float>(bits & 1023) / 1023 : static_cast<float>(bits & 3) / 3;
  };
  const auto rgba16 = [](const std::uint8_t* p, int c) {
    return half_to_float(load<std::uint16_t>(p + 2 * c));
  };
  const auto rgba32 = [](const std::uint8_t* p, int c) { return load<float>(p + 4 * c); };
  return {
      {VK_FORMAT_R8G8B8A8_UNORM, 4, rgba8},           {VK_FORMAT_R8G8B8A8_SRGB, 4, rgba8},
      {VK_FORMAT_B8G8R8A8_UNORM, 4, bgra8},           {VK_FORMAT_B8G8R8A8_SRGB, 4, bgra8},
      {VK_FORMAT_A2B10G10R10_UNORM_PACK32, 4, rgb10}, {VK_FORMAT_R16G16B16A16_SFLOAT, 8, rgba16},
      {VK_FORMAT_R32G32B32A32_SFLOAT, 16, rgba32}};
}

inline const PixelLayout& pixel_layout(VkFormat format) {
  static const std::vector<PixelLayout> all = pixel_layouts();
  return *std::find_if(all.begin(), all.end(),
                       [=](const PixelLayout& l) { return l.format == format; });
}

struct ImageDifference {
  double psnr;   // dB, of the colours
  double alpha;  // largest difference
};

inline ImageDifference difference(const player::Frame& expected,
                                  const std::vector<std::uint8_t>& found,
                                  const PixelLayout& layout) {
  const std::size_t pixels = expected.alpha.data.size();
  double squares = 0, alpha = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* pixel = found.data() + i * layout.bytes;
    for (int c = 0; c < 3; ++c) {
      // Formats other than floats clamp to [0, 1], so compare the clamped values.
      const double target = std::clamp(expected.colour.plane(c)[i], 0.0f, 1.0f);
      const double error = std::clamp(layout.channel(pixel, c), 0.0f, 1.0f) - target;
      squares += error * error;
    }
    alpha = std::max<double>(alpha, std::abs(layout.channel(pixel, 3) - expected.alpha.data[i]));
  }
  return {-10 * std::log10(squares / static_cast<double>(3 * pixels) + 1e-20), alpha};
}

inline double psnr(const player::Frame& expected, VulkanHost& host, const HostImage& image) {
  const PixelLayout& layout = pixel_layout(image.format);
  return difference(expected, host.read(image, kReadable, layout.bytes), layout).psnr;
}

}  // namespace stgs::testing
