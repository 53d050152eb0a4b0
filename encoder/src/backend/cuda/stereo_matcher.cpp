// SPDX-License-Identifier: Apache-2.0
#include <string>
#include <utility>

#include "backend/cuda/memory.h"
#include "backend/cuda/serial_gpu.h"
#include "backend/cuda/stereo.h"
#include "geometry/view_matcher.h"

namespace stgs::encoder {
namespace {

using cuda::DeviceArray;
using geometry::StereoImage;

constexpr const char* kUploading = "uploading images for stereo";

template <typename T>
Status upload(const T* values, std::size_t n, DeviceArray<T>& array, cudaStream_t stream) {
  STGS_TRY(array.ensure(n));
  return cuda::cuda_status(
      cudaMemcpyAsync(array.data(), values, n * sizeof(T), cudaMemcpyHostToDevice, stream),
      kUploading);
}

template <typename T>
Status download(const DeviceArray<T>& array, std::size_t n, T* values, cudaStream_t stream) {
  return cuda::cuda_status(
      cudaMemcpyAsync(values, array.data(), n * sizeof(T), cudaMemcpyDeviceToHost, stream),
      "reading the result of stereo");
}

std::size_t pixels_of(const StereoImage& image) {
  return static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
}

// An image on the device.
struct DeviceImage {
  DeviceArray<std::uint32_t> corners;
  DeviceArray<float> depth;

  // Replaces the host pointers of `image`.
  Status take(StereoImage& image, cudaStream_t stream) {
    const std::size_t pixels = pixels_of(image);
    STGS_TRY(upload(image.corners, pixels, corners, stream));
    image.corners = corners.data();
    if (image.depth == nullptr) return {};
    STGS_TRY(upload(image.depth, pixels, depth, stream));
    image.depth = depth.data();
    return {};
  }
};

// Runs one pass at a time, and uploads the images for each.
class CudaMatcher final : public geometry::ViewMatcher {
 public:
  Status create(int gpu) { return gpu_.create(gpu); }
  std::string name() const override { return gpu_.name(); }

  Status run(const geometry::ViewPass& pass) override {
    return gpu_.run([&] { return run_pass(pass); });
  }

 private:
  Status run_pass(const geometry::ViewPass& pass) {
    geometry::StereoProblem problem = pass.problem;
    STGS_TRY(reference_.take(problem.reference, stream_));
    for (int k = 0; k < problem.source_count; ++k)
      STGS_TRY(sources_[k].take(problem.sources[k].image, stream_));
    const std::size_t pixels = pixels_of(problem.reference);
    STGS_TRY(upload(pass.map.planes, pixels, planes_, stream_));
    STGS_TRY(upload(pass.map.costs, pixels, costs_, stream_));
    const geometry::PlaneMap map{planes_.data(), costs_.data()};
    if (pass.from_random) cuda::launch_stereo_start(problem, map, pass.seed, stream_);
    for (int k = pass.first; k < pass.first + pass.iterations; ++k) {
      for (const int colour : {0, 1})
        cuda::launch_stereo_update(problem, map, colour, k, pass.seed, stream_);
    }
    STGS_TRY(cuda::cuda_status(cudaGetLastError(), "starting stereo"));
    STGS_TRY(download(planes_, pixels, pass.map.planes, stream_));
    STGS_TRY(download(costs_, pixels, pass.map.costs, stream_));
    return stream_.wait();
  }

  cuda::SerialGpu gpu_;
  const cuda::Stream& stream_ = gpu_.stream();
  DeviceImage reference_, sources_[geometry::kMaxSources];
  DeviceArray<geometry::Hypothesis> planes_;
  DeviceArray<float> costs_;
};

}  // namespace

Result<std::unique_ptr<geometry::ViewMatcher>> geometry::make_cuda_matcher(int gpu) {
  auto matcher = std::make_unique<CudaMatcher>();
  STGS_TRY(matcher->create(gpu));
  return std::unique_ptr<ViewMatcher>(std::move(matcher));
}

}  // namespace stgs::encoder
