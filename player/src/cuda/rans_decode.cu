// SPDX-License-Identifier: Apache-2.0
// A warp decodes a rANS block, one lane each. The warps of a thread block process the planes
// together: the table of a plane is loaded to shared memory once for all warps, while the plane
// before is decoded.
#include "cuda/rans_decode.h"

#include <cuda_pipeline_primitives.h>

#include "stgs/format/math/cuda.cuh"

namespace stgs::player::cuda {
namespace {

using math::kAllLanes;

constexpr unsigned kThreads = 32 * kRansWarps;
constexpr std::uint32_t kLanes = kRansLanes, kBlock = kRansBlock;

// The words of a block: the next 32 and the 32 after them, one of each per lane, so that loads are
// issued long before their results are needed.
class Words {
 public:
  __device__ Words(const std::uint16_t* words, std::uint32_t count, unsigned lane)
      : words_(words), count_(count), lane_(lane), near_(load(0)), far_(load(kLanes)) {}

  // Returns the next word for each lane with `needs_word`, in lane order; 0 past the end. The whole
  // warp calls it.
  __device__ std::uint32_t take(bool needs_word) {
    const unsigned takers = __ballot_sync(kAllLanes, needs_word);
    const unsigned at = used_ + __popc(takers & ((1u << lane_) - 1u));
    const std::uint32_t near = __shfl_sync(kAllLanes, near_, static_cast<int>(at % kLanes));
    const std::uint32_t far = __shfl_sync(kAllLanes, far_, static_cast<int>(at % kLanes));
    used_ += __popc(takers);
    if (used_ >= kLanes) {
      used_ -= kLanes;
      base_ += kLanes;
      near_ = far_;
      far_ = load(base_ + kLanes);
    }
    return at < kLanes ? near : far;
  }
  __device__ bool at_end() const { return base_ + used_ == count_; }

 private:
  __device__ std::uint32_t load(std::uint64_t first) const {
    return first + lane_ < count_ ? __ldg(words_ + first + lane_) : 0u;
  }

  const std::uint16_t* words_;
  std::uint64_t count_, base_ = 0;  // base_: of the next 32
  unsigned lane_, used_ = 0;        // used_: of the next 32, below 32
  std::uint32_t near_, far_;
};

// As rans_lanes(), and 0 for no symbols.
__device__ std::uint32_t lanes_of(std::uint32_t count) {
  constexpr auto kSymbols = static_cast<std::uint32_t>(kRansLaneSymbols);
  return count == 0 ? 0 : 1u << (32 - __clz(static_cast<int>((count - 1) / kSymbols)));
}

// Starts loading the table of a plane to shared memory.
__device__ void load_lookup(const RansGroup& group, std::uint32_t plane, std::uint32_t* to) {
  const std::uint32_t* from = group.lookups + std::uint64_t{group.tables[plane]} * kRansTotal;
  for (unsigned i = 4 * threadIdx.x; i < kRansTotal; i += 4 * kThreads) {
    __pipeline_memcpy_async(to + i, from + i, sizeof(uint4));
  }
  __pipeline_commit();
}

// Decodes the symbols of a warp's block in one plane. All lanes take every step together, since
// they share the words.
__device__ void decode_plane(const std::uint32_t* lookup, std::uint32_t count, std::uint32_t lanes,
                             unsigned lane, std::uint32_t& state, Words& words, std::uint8_t* out) {
  for (std::uint32_t first = 0; first < count; first += lanes) {
    const bool active = lane < lanes && first + lane < count;
    std::uint32_t x = state;
    if (active) {
      const std::uint32_t entry = lookup[x % kRansTotal];
      x = ((entry >> kRansBits) % kRansTotal + 1) * (x >> kRansBits) + entry % kRansTotal;
      out[first + lane] = static_cast<std::uint8_t>(entry >> 24);
    }
    const bool needs_word = active && x < kRansLow;
    const std::uint32_t word = words.take(needs_word);
    state = needs_word ? x << 16 | word : x;
  }
}

__global__ void __launch_bounds__(kThreads)
    decode_kernel(const RansGroup* groups, const RansWork* works) {
  __shared__ alignas(16) std::uint32_t lookups[2][kRansTotal];  // of this plane and the next
  const RansWork work = works[blockIdx.x];
  const RansGroup group = groups[work.group];
  const unsigned lane = threadIdx.x % kLanes;
  const std::uint64_t block = work.first_block + threadIdx.x / kLanes;
  const std::uint64_t begin = block * kBlock;
  // A warp past the last block decodes nothing, but helps to load the tables.
  const std::uint32_t count =
      begin < group.count
          ? static_cast<std::uint32_t>(min(std::uint64_t{kBlock}, group.count - begin))
          : 0;
  const std::uint32_t lanes = lanes_of(count);
  const RansBlockLocation location = count > 0 ? group.blocks[block] : RansBlockLocation{};
  const auto* stored = reinterpret_cast<const std::uint16_t*>(group.bytes + location.states);
  std::uint32_t state = kRansLow;
  if (lane < lanes) {
    state = __ldg(stored + 2 * lane) | static_cast<std::uint32_t>(__ldg(stored + 2 * lane + 1))
                                           << 16;
  }
  Words words(stored + 2 * lanes, location.words, lane);
  if (group.planes > 0) load_lookup(group, 0, lookups[0]);
  for (std::uint32_t p = 0; p < group.planes; ++p) {
    __pipeline_wait_prior(0);
    __syncthreads();  // the table is loaded, and all warps have finished the plane before
    if (p + 1 < group.planes) load_lookup(group, p + 1, lookups[(p + 1) % 2]);
    decode_plane(lookups[p % 2], count, lanes, lane, state, words,
                 group.symbols + std::uint64_t{p} * group.count + begin);
  }
  const bool sound = __all_sync(kAllLanes, state == kRansLow) && words.at_end();
  if (lane == 0 && !sound) atomicAdd(group.damaged, 1u);
}

}  // namespace

std::vector<RansWork> rans_work(std::span<const std::uint32_t> counts) {
  std::vector<RansWork> works;
  for (std::uint32_t g = 0; g < counts.size(); ++g) {
    const auto blocks = static_cast<std::uint32_t>(rans_blocks(counts[g]));
    for (std::uint32_t b = 0; b < blocks; b += kRansWarps) works.push_back({g, b});
  }
  return works;
}

void decode_rans(const RansGroup* groups, const RansWork* work, std::uint32_t count,
                 cudaStream_t stream) {
  if (count > 0) decode_kernel<<<count, kThreads, 0, stream>>>(groups, work);
}

}  // namespace stgs::player::cuda
