// SPDX-License-Identifier: Apache-2.0
// The C interface into memory of a CUDA device, compared with its own pictures of the processor.
#include <cuda_runtime_api.h>

#include <atomic>
#include <cmath>

#include "sdk_fixture.h"
#include "stgs/stgs_cuda.h"

namespace stgs::testing {
namespace {

constexpr double kMoment = 0.4;
constexpr std::uint8_t kGuard = 0xA5;

void must(cudaError_t error) {
  INFO(cudaGetErrorString(error));
  REQUIRE(error == cudaSuccess);
}

RendererPtr cuda_renderer() {
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.backend = STGS_BACKEND_CUDA;
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

// A stream that waits for nothing but itself.
struct Stream {
  cudaStream_t handle = nullptr;
  Stream() { must(cudaStreamCreateWithFlags(&handle, cudaStreamNonBlocking)); }
  ~Stream() { cudaStreamDestroy(handle); }
};

// Bytes of the device, kGuard at first.
struct Memory {
  std::uint8_t* data = nullptr;
  std::size_t bytes;
  explicit Memory(std::size_t n) : bytes(n) {
    void* made = nullptr;
    must(cudaMalloc(&made, bytes));
    data = static_cast<std::uint8_t*>(made);
    must(cudaMemset(data, kGuard, bytes));
    must(cudaDeviceSynchronize());
  }
  ~Memory() { cudaFree(data); }
  std::vector<std::uint8_t> read() const {
    const Stream own;
    std::vector<std::uint8_t> out(bytes);
    must(cudaMemcpyAsync(out.data(), data, bytes, cudaMemcpyDeviceToHost, own.handle));
    must(cudaStreamSynchronize(own.handle));
    return out;
  }
};

double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  REQUIRE(a.size() == b.size());
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) squares += std::pow(a[i] - b[i], 2);
  return -10 * std::log10(squares / (255.0 * 255.0 * static_cast<double>(a.size())) + 1e-20);
}

// Holds a stream up until it is opened.
struct Gate {
  std::atomic<bool> open = false;
  explicit Gate(cudaStream_t stream) {
    must(cudaLaunchHostFunc(
        stream, [](void* self) { static_cast<Gate*>(self)->open.wait(false); }, this));
  }
  ~Gate() { release(); }
  void release() {
    open = true;
    open.notify_all();
  }
};

}  // namespace

TEST_CASE("two views go to device memory, bytes and planes, whatever their strides", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer(), reference = cpu_renderer();
  stgs_view views[2] = {start_view(scene.get()), start_view(scene.get())};
  REQUIRE(stgs_view_resize(&views[1], 33, 17) == STGS_OK);
  views[1].background[0] = 1;
  constexpr std::size_t kStride = 512, kPixels = 33 * 17;
  const Memory bytes(kStride * kSdkHeight);
  std::vector<std::unique_ptr<Memory>> planes;
  std::vector<std::vector<float>> expected(5, std::vector<float>(kPixels));
  stgs_image pictures[2] = {empty_picture(), empty_picture()};
  stgs_image wanted = empty_picture();
  pictures[0].rgba8 = {bytes.data, kStride, bytes.bytes};
  stgs_buffer* to[] = {&pictures[1].rgb[0], &pictures[1].rgb[1], &pictures[1].rgb[2],
                       &pictures[1].alpha, &pictures[1].depth};
  stgs_buffer* want[] = {&wanted.rgb[0], &wanted.rgb[1], &wanted.rgb[2], &wanted.alpha,
                         &wanted.depth};
  for (std::size_t i = 0; i < 5; ++i) {
    planes.push_back(std::make_unique<Memory>(kPixels * sizeof(float)));
    *to[i] = {planes[i]->data, 0, planes[i]->bytes};
    *want[i] = {expected[i].data(), 0, kPixels * sizeof(float)};
  }
  const Stream stream;
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), kMoment, views, pictures, 2,
                           stream.handle) == STGS_OK);
  must(cudaStreamSynchronize(stream.handle));

  const auto found = bytes.read();
  std::vector<std::uint8_t> tight;
  for (std::size_t y = 0; y < kSdkHeight; ++y) {
    const auto row = found.begin() + static_cast<std::ptrdiff_t>(y * kStride);
    tight.insert(tight.end(), row, row + 4 * kSdkWidth);
    // Between the rows nothing is written.
    CHECK(*(row + 4 * kSdkWidth) == kGuard);
  }
  CHECK(psnr(draw_rgba8(reference.get(), scene.get(), kMoment, views[0]), tight) >= 50);
  REQUIRE(stgs_render(reference.get(), scene.get(), kMoment, &views[1], &wanted, 1) == STGS_OK);
  for (std::size_t i = 0; i < 5; ++i) {
    const auto raw = planes[i]->read();
    double squares = 0, most = 0;
    for (std::size_t k = 0; k < kPixels; ++k) {
      float value = 0;
      std::memcpy(&value, raw.data() + sizeof(float) * k, sizeof value);
      squares += std::pow(value - expected[i][k], 2);
      most = std::max(most, std::abs(static_cast<double>(expected[i][k])));
    }
    INFO("plane " << i);
    CHECK(-10 * std::log10(squares / (most * most * kPixels) + 1e-20) >= 50);
  }
}

TEST_CASE("a picture is written in the stream's order", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer();
  const stgs_view view = start_view(scene.get());
  const Memory bytes(std::size_t{4} * view.width * view.height);
  stgs_image picture = empty_picture();
  picture.rgba8 = {bytes.data, 0, bytes.bytes};
  const Stream stream;
  Gate gate(stream.handle);
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), kMoment, &view, &picture, 1,
                           stream.handle) == STGS_OK);
  // The call has returned, and the stream has not got so far.
  CHECK(cudaStreamQuery(stream.handle) == cudaErrorNotReady);
  CHECK(bytes.read() == std::vector<std::uint8_t>(bytes.bytes, kGuard));
  gate.release();
  must(cudaStreamSynchronize(stream.handle));
  const auto expected = draw_rgba8(cpu_renderer().get(), scene.get(), kMoment, view);
  CHECK(psnr(expected, bytes.read()) >= 50);
  // The default stream, and to the host beside it.
  REQUIRE(stgs_cuda_render(renderer.get(), scene.get(), 0.9, &view, &picture, 1, nullptr) ==
          STGS_OK);
  CHECK(psnr(draw_rgba8(renderer.get(), scene.get(), kMoment, view), expected) >= 50);
  must(cudaStreamSynchronize(nullptr));
  CHECK(psnr(draw_rgba8(cpu_renderer().get(), scene.get(), 0.9, view), bytes.read()) >= 50);
}

TEST_CASE("a picture that cannot be written is told of", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cuda_renderer();
  const stgs_view view = start_view(scene.get());
  const Memory bytes(std::size_t{4} * view.width * view.height + 8);
  stgs_image picture = empty_picture();
  const auto render = [&] {
    return stgs_cuda_render(renderer.get(), scene.get(), kMoment, &view, &picture, 1, nullptr);
  };
  CHECK(render() == STGS_ERROR_ARGUMENT);
  picture.rgba8 = {bytes.data, 0, 7};
  CHECK(render() == STGS_ERROR_ARGUMENT);
  picture.rgba8 = {bytes.data + 1, 0, bytes.bytes - 1};
  CHECK(render() == STGS_ERROR_ARGUMENT);
  CHECK(std::string(error_of(renderer.get()).message).find("multiples of 4") != std::string::npos);
}

}  // namespace stgs::testing
