// SPDX-License-Identifier: Apache-2.0
// The only instantiation of CUB's device-wide sort and scan, because they are slow to compile.
#include <algorithm>
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "backend/cuda/kernels.h"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 256;

__global__ void fill_iota(std::uint32_t* iota, std::size_t n) {
  const std::size_t i = std::size_t{blockIdx.x} * kBlock + threadIdx.x;
  if (i < n) iota[i] = static_cast<std::uint32_t>(i);
}

}  // namespace

std::size_t sort_memory_bytes(std::size_t items) {
  std::size_t sort = 0, scan = 0;
  std::uint32_t* none = nullptr;
  const int n = static_cast<int>(items);
  cub::DeviceRadixSort::SortPairs(nullptr, sort, none, none, none, none, n);
  cub::DeviceScan::ExclusiveSum(nullptr, scan, none, none, n);
  return std::max(sort, scan);
}

void launch_iota(std::uint32_t* iota, std::size_t n, cudaStream_t stream) {
  fill_iota<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(iota, n);
}

void sort_indices(const Workspace& w, const std::uint32_t* keys, std::uint32_t* keys_sorted,
                  std::uint32_t* indices, std::size_t n, int bits, cudaStream_t stream) {
  std::size_t bytes = w.sort_bytes;
  cub::DeviceRadixSort::SortPairs(w.sort_memory, bytes, keys, keys_sorted, w.iota, indices,
                                  static_cast<int>(n), 0, bits, stream);
}

void exclusive_sum(const Workspace& w, const std::uint32_t* values, std::uint32_t* sums,
                   std::size_t n, cudaStream_t stream) {
  std::size_t bytes = w.sort_bytes;
  cub::DeviceScan::ExclusiveSum(w.sort_memory, bytes, values, sums, static_cast<int>(n), stream);
}

}  // namespace stgs::encoder::cuda
