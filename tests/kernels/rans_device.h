// SPDX-License-Identifier: Apache-2.0
// rANS groups in GPU memory, for the test and the benchmark of the CUDA decoder.
#pragma once

#include <cuda_runtime_api.h>

#include <cstring>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "codec/rans.h"
#include "cuda/rans_decode.h"

namespace stgs::testing {

inline void check_cuda(cudaError_t error) {
  if (error != cudaSuccess) throw std::runtime_error(cudaGetErrorString(error));
}

// A device array, initialised from host values.
template <typename T>
class DeviceValues {
 public:
  DeviceValues() = default;
  explicit DeviceValues(std::span<const T> values) : size_(values.size()) {
    check_cuda(cudaMalloc(&data_, std::max<std::size_t>(1, values.size_bytes())));
    check_cuda(cudaMemcpy(data_, values.data(), values.size_bytes(), cudaMemcpyHostToDevice));
  }
  DeviceValues(DeviceValues&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(other.size_) {}
  DeviceValues& operator=(DeviceValues&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~DeviceValues() { cudaFree(data_); }

  T* data() const { return static_cast<T*>(data_); }
  std::vector<T> read() const {
    std::vector<T> values(size_);
    check_cuda(cudaMemcpy(values.data(), data_, size_ * sizeof(T), cudaMemcpyDeviceToHost));
    return values;
  }

 private:
  void* data_ = nullptr;
  std::size_t size_ = 0;
};

// A group that rans_layout accepts, and memory for its symbols.
struct DeviceGroup {
  DeviceGroup(std::span<const std::uint8_t> stored, std::size_t n,
              const std::vector<RansTable>& tables) {
    const auto locations = rans_layout(stored, n);
    if (!locations.ok()) throw std::runtime_error(locations.status().message());
    std::vector<RansLookup> filled_tables(tables.size());
    for (std::size_t p = 0; p < tables.size(); ++p) rans_lookup(tables[p], filled_tables[p]);
    bytes = DeviceValues<std::uint8_t>(stored);
    blocks = DeviceValues<RansBlockLocation>(*locations);
    lookups = DeviceValues<RansLookup>(filled_tables);
    std::vector<std::uint16_t> numbers(tables.size());
    std::iota(numbers.begin(), numbers.end(), std::uint16_t{0});
    table_numbers = DeviceValues<std::uint16_t>(numbers);
    symbols = DeviceValues<std::uint8_t>(std::vector<std::uint8_t>(n * tables.size()));
    damaged = DeviceValues<std::uint32_t>(std::vector<std::uint32_t>(1));
    group.bytes = bytes.data();
    group.blocks = blocks.data();
    group.lookups = reinterpret_cast<const std::uint32_t*>(lookups.data());
    group.tables = table_numbers.data();
    group.symbols = symbols.data();
    group.damaged = damaged.data();
    group.count = static_cast<std::uint32_t>(n);
    group.planes = static_cast<std::uint32_t>(tables.size());
  }

  DeviceValues<std::uint8_t> bytes, symbols;
  DeviceValues<RansBlockLocation> blocks;
  DeviceValues<RansLookup> lookups;
  DeviceValues<std::uint16_t> table_numbers;
  DeviceValues<std::uint32_t> damaged;
  player::cuda::RansGroup group;
};

// Decodes several groups in one launch.
class DeviceDecoder {
 public:
  explicit DeviceDecoder(const std::vector<DeviceGroup>& groups) {
    std::vector<player::cuda::RansGroup> all;
    std::vector<std::uint32_t> sizes;
    for (const DeviceGroup& g : groups) {
      all.push_back(g.group);
      sizes.push_back(g.group.count);
    }
    const auto work = player::cuda::rans_work(sizes);
    groups_ = DeviceValues<player::cuda::RansGroup>(all);
    work_ = DeviceValues<player::cuda::RansWork>(work);
    count_ = static_cast<std::uint32_t>(work.size());
  }
  // Decodes and waits.
  void decode() {
    player::cuda::decode_rans(groups_.data(), work_.data(), count_, nullptr);
    check_cuda(cudaGetLastError());
    check_cuda(cudaDeviceSynchronize());
  }

 private:
  DeviceValues<player::cuda::RansGroup> groups_;
  DeviceValues<player::cuda::RansWork> work_;
  std::uint32_t count_ = 0;
};

}  // namespace stgs::testing
