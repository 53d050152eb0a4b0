// SPDX-License-Identifier: Apache-2.0
// The C API rendering into memory of a CUDA device, compared with its own CPU renderer.
#include <cmath>

#include "fixtures/cuda_device.h"
#include "sdk_fixture.h"
#include "stgs/stgs_cuda.h"

namespace stgs::testing {
namespace {

constexpr double kTime = 0.4;  // seconds

RendererPtr cuda_renderer() {
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.backend = STGS_BACKEND_CUDA;
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  REQUIRE(a.size() == b.size());
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) squares += std::pow(a[i] - b[i], 2);
  return -10 * std::log10(squares / (255.0 * 255.0 * static_cast<double>(a.size())) + 1e-20);
}

}  // namespace

TEST_CASE("two views render into device memory as bytes and planes with any stride", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer(), reference = cpu_renderer();
  stgs_view views[2] = {start_view(scene.get()), start_view(scene.get())};
  REQUIRE(stgs_view_resize(&views[1], 33, 17) == STGS_OK);
  views[1].background[0] = 1;
  constexpr std::size_t kStride = 512, kPixels = 33 * 17;
  const DeviceMemory bytes(kStride * kSdkHeight);
  std::vector<std::unique_ptr<DeviceMemory>> planes;
  std::vector<std::vector<float>> expected(5, std::vector<float>(kPixels));
  stgs_image images[2] = {empty_image(), empty_image()};
  stgs_image reference_image = empty_image();
  images[0].rgba8 = {bytes.data, kStride, bytes.bytes};
  stgs_buffer* outputs[] = {&images[1].rgb[0], &images[1].rgb[1], &images[1].rgb[2],
                            &images[1].alpha, &images[1].depth};
  stgs_buffer* references[] = {&reference_image.rgb[0], &reference_image.rgb[1],
                               &reference_image.rgb[2], &reference_image.alpha,
                               &reference_image.depth};
  for (std::size_t i = 0; i < 5; ++i) {
    planes.push_back(std::make_unique<DeviceMemory>(kPixels * sizeof(float)));
    *outputs[i] = {planes[i]->data, 0, planes[i]->bytes};
    *references[i] = {expected[i].data(), 0, kPixels * sizeof(float)};
  }
  const Stream stream;
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), kTime, views, images, 2, stream.handle) ==
          STGS_OK);
  require_success(cudaStreamSynchronize(stream.handle));

  const auto rendered = bytes.read();
  std::vector<std::uint8_t> tight;
  for (std::size_t y = 0; y < kSdkHeight; ++y) {
    const auto row = rendered.begin() + static_cast<std::ptrdiff_t>(y * kStride);
    tight.insert(tight.end(), row, row + 4 * kSdkWidth);
    // The padding between rows is not written.
    CHECK(*(row + 4 * kSdkWidth) == kGuard);
  }
  CHECK(psnr(render_rgba8(reference.get(), scene.get(), kTime, views[0]), tight) >= 50);
  REQUIRE(stgs_render(reference.get(), scene.get(), kTime, &views[1], &reference_image, 1) ==
          STGS_OK);
  for (std::size_t i = 0; i < 5; ++i) {
    const auto raw = planes[i]->read();
    double squares = 0, peak = 0;
    for (std::size_t k = 0; k < kPixels; ++k) {
      float value = 0;
      std::memcpy(&value, raw.data() + sizeof(float) * k, sizeof value);
      squares += std::pow(value - expected[i][k], 2);
      peak = std::max(peak, std::abs(static_cast<double>(expected[i][k])));
    }
    INFO("plane " << i);
    CHECK(-10 * std::log10(squares / (peak * peak * kPixels) + 1e-20) >= 50);
  }
}

TEST_CASE("an image is written in stream order", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer();
  const stgs_view view = start_view(scene.get());
  const DeviceMemory bytes(std::size_t{4} * view.width * view.height);
  stgs_image image = empty_image();
  image.rgba8 = {bytes.data, 0, bytes.bytes};
  const Stream stream;
  Gate gate(stream.handle);
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), kTime, &view, &image, 1, stream.handle) ==
          STGS_OK);
  // The call has returned before the stream reaches the render.
  CHECK(cudaStreamQuery(stream.handle) == cudaErrorNotReady);
  CHECK(bytes.read() == std::vector<std::uint8_t>(bytes.bytes, kGuard));
  gate.release();
  require_success(cudaStreamSynchronize(stream.handle));
  const auto expected = render_rgba8(cpu_renderer().get(), scene.get(), kTime, view);
  CHECK(psnr(expected, bytes.read()) >= 50);
  // Renders to the default stream, and to host memory meanwhile.
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), 0.9, &view, &image, 1, nullptr) == STGS_OK);
  CHECK(psnr(render_rgba8(renderer.get(), scene.get(), kTime, view), expected) >= 50);
  require_success(cudaStreamSynchronize(nullptr));
  CHECK(psnr(render_rgba8(cpu_renderer().get(), scene.get(), 0.9, view), bytes.read()) >= 50);
}

TEST_CASE("an invalid device image is rejected", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer();
  const stgs_view view = start_view(scene.get());
  const DeviceMemory bytes(std::size_t{4} * view.width * view.height + 8);
  stgs_image image = empty_image();
  const auto render = [&] {
    return stgs_cuda_render(renderer.get(), scene.get(), kTime, &view, &image, 1, nullptr);
  };
  CHECK(render() == STGS_ERROR_ARGUMENT);
  image.rgba8 = {bytes.data, 0, 7};
  CHECK(render() == STGS_ERROR_ARGUMENT);
  image.rgba8 = {bytes.data + 1, 0, bytes.bytes - 1};
  CHECK(render() == STGS_ERROR_ARGUMENT);
  CHECK(std::string(error_of(renderer.get()).message).find("multiples of 4") != std::string::npos);
}

}  // namespace stgs::testing
