// SPDX-License-Identifier: Apache-2.0
// derive_from_coupled of train/coupled_state.h, one thread per primitive.
#include "backend/cuda/coupled.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 128;

__global__ void derive_coupled(const Primitives p) {
  const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
  if (i >= p.n) return;
  const math::CoupledPrimitive primitive = math::coupled_primitive(load_coupled(p, i), p.tick);
  write3(p.log_scale + std::size_t{3} * i, primitive.log_scale);
  write4(p.rotation + std::size_t{4} * i, primitive.rotation);
  write3(p.u + std::size_t{3} * i, primitive.u);
  p.sigma[i] = primitive.sigma;
}

}  // namespace

void launch_derive_coupled(const Primitives& p, cudaStream_t stream) {
  derive_coupled<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p);
}

}  // namespace stgs::encoder::cuda
