// SPDX-License-Identifier: Apache-2.0
#include "geometry/motion_finder.h"

#include <string>

#include "backend/cuda/lane_pool.h"
#include "backend/cuda/motion_lane.h"
#include "backend/cuda/select_gpu.h"

namespace stgs::encoder {
namespace {

// Cameras at a time. A camera keeps its lane while its frames are read and its masks are written,
// because the images and the flow of the chunk before are on the GPU.
constexpr std::size_t kMotionLanes = 16;

class CudaMotionFinder final : public geometry::MotionFinder {
 public:
  CudaMotionFinder(int gpu, std::string name) : name_(std::move(name)), lanes_(gpu, kMotionLanes) {}

  std::string name() const override { return name_; }
  Result<geometry::MedianBackground> find_background(
      const geometry::MedianSamples& samples) override {
    return lanes_.take()->find_background(samples);
  }
  Status find_motion(const geometry::MotionSequence& sequence) override {
    return lanes_.take()->find_motion(sequence);
  }
  Result<std::vector<std::int16_t>> find_flow(const geometry::FlowPair& pair) override {
    return lanes_.take()->find_flow(pair);
  }

 private:
  const std::string name_;
  cuda::LanePool<cuda::MotionLane> lanes_;
};

}  // namespace

Result<std::unique_ptr<geometry::MotionFinder>> geometry::make_cuda_motion_finder(int gpu) {
  STGS_ASSIGN(const cudaDeviceProp properties, cuda::select_gpu(gpu));
  int device = 0;
  STGS_TRY(cuda::cuda_status(cudaGetDevice(&device), "choosing the GPU"));
  return std::unique_ptr<MotionFinder>(
      std::make_unique<CudaMotionFinder>(device, fmt::format("cuda ({})", properties.name)));
}

}  // namespace stgs::encoder
