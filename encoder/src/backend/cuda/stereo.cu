// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/stereo.h"

#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

using geometry::PlaneMap;
using geometry::StereoProblem;

// Threads next to each other have supports that overlap.
constexpr int kSide = 16;

__global__ void __launch_bounds__(kSide* kSide)
    start(const StereoProblem problem, const PlaneMap map, std::uint64_t seed) {
  const int x = static_cast<int>(blockIdx.x) * kSide + static_cast<int>(threadIdx.x);
  const int y = static_cast<int>(blockIdx.y) * kSide + static_cast<int>(threadIdx.y);
  if (x >= problem.reference.width || y >= problem.reference.height) return;
  geometry::start_pixel(problem, map, x, y, seed);
}

// One thread per pixel of the colour: every second one of a row.
__global__ void __launch_bounds__(kSide* kSide)
    update(const StereoProblem problem, const PlaneMap map, int colour, int iteration,
           std::uint64_t seed) {
  const int y = static_cast<int>(blockIdx.y) * kSide + static_cast<int>(threadIdx.y);
  const int x = 2 * (static_cast<int>(blockIdx.x) * kSide + static_cast<int>(threadIdx.x)) +
                ((y + colour) & 1);
  if (x >= problem.reference.width || y >= problem.reference.height) return;
  geometry::update_pixel(problem, map, x, y, iteration, seed);
}

dim3 blocks(int width, int height) {
  return dim3(blocks_of(static_cast<std::size_t>(width), kSide),
              blocks_of(static_cast<std::size_t>(height), kSide));
}

}  // namespace

void launch_stereo_start(const StereoProblem& problem, const PlaneMap& map, std::uint64_t seed,
                         cudaStream_t stream) {
  start<<<blocks(problem.reference.width, problem.reference.height), dim3(kSide, kSide), 0,
          stream>>>(problem, map, seed);
}

void launch_stereo_update(const StereoProblem& problem, const PlaneMap& map, int colour,
                          int iteration, std::uint64_t seed, cudaStream_t stream) {
  update<<<blocks((problem.reference.width + 1) / 2, problem.reference.height), dim3(kSide, kSide),
           0, stream>>>(problem, map, colour, iteration, seed);
}

}  // namespace stgs::encoder::cuda
