// SPDX-License-Identifier: Apache-2.0
// A step of several ranks on GPUs. Each rank writes the contributions of its view to a block of
// device memory. All blocks are gathered on every GPU, and every GPU sums them itself, in rank
// order (backend/cpu/rank_step.h is the CPU equivalent).
//
// A block consists of a head and kContributionRows rows with one float per primitive:
// - the fields of the update's stage before kBasis;
// - the gradient, absolute gradient and error for densification;
// - 1 if the primitive is visible in the view, else 0. If 0, the other rows are undefined.
#pragma once

#include <cstddef>
#include <cstdint>

#include "backend/cuda/kernels.h"
#include "train/adam.h"

namespace stgs::encoder::cuda {

inline constexpr int kMaxBlocks = 64;  // = kMaxRanks, whose header cannot be used in device code
inline constexpr int kStatisticsRow = 20, kVisibleRow = 23, kContributionRows = 24;

struct RankHead {
  StepRecord record;
  float by_colour_map[12];
};
inline constexpr std::size_t kHeadBytes = 256;
static_assert(sizeof(RankHead) <= kHeadBytes);

// The blocks of all ranks, contiguous.
struct RankBlocks {
  std::uint8_t* data = nullptr;
  std::size_t bytes = 0;     // per block
  std::uint32_t stride = 0;  // floats per row
  int count = 1, own = 0;
};

// The views of all ranks, known to every rank.
struct RankViews {
  float4 centre_ticks[kMaxBlocks];
  std::uint32_t colour_index[kMaxBlocks];
};

inline std::uint32_t row_stride(std::size_t primitives) {
  return static_cast<std::uint32_t>((primitives + 63) / 64 * 64);
}
inline std::size_t block_bytes(std::size_t primitives) {
  return kHeadBytes + std::size_t{kContributionRows} * row_stride(primitives) * sizeof(float);
}
__host__ __device__ inline RankHead* rank_head(const RankBlocks& blocks, int rank) {
  return reinterpret_cast<RankHead*>(blocks.data + static_cast<std::size_t>(rank) * blocks.bytes);
}
__host__ __device__ inline float* rank_rows(const RankBlocks& blocks, int rank) {
  return reinterpret_cast<float*>(blocks.data + static_cast<std::size_t>(rank) * blocks.bytes +
                                  kHeadBytes);
}

// The first part of launch_update: writes the rows of this rank's block.
void launch_contributions(const Primitives& p, const View& view, const UpdateSettings& settings,
                          const Workspace& w, const RankBlocks& blocks, cudaStream_t stream);
// The first part of launch_finish: writes the head of this rank's block and resets the counters for
// the next step.
void launch_head(const View& view, std::uint32_t n, const LossWeights& weights, const Workspace& w,
                 const RankBlocks& blocks, cudaStream_t stream);
// From the gathered blocks, applies one Adam step with the mean gradient of the views to each
// primitive visible in any of them. Gathers statistics as if each view had been a separate step. No
// effect if a rank overflowed.
void launch_apply(const Primitives& p, const RankViews& views, int coefficients,
                  const UpdateSettings& settings, AdamBetas betas, const RankBlocks& blocks,
                  cudaStream_t stream);
// Updates the colour maps with one Adam step per view, in rank order, and writes `records` (mapped
// host memory), one per rank. If a rank overflowed, sets the overflow of all ranks, so that steps
// have no effect until it is cleared.
void launch_finish_ranks(const RankViews& views, const ColourMaps& colour, float rate,
                         Counters* counters, const RankBlocks& blocks, StepRecord* records,
                         cudaStream_t stream);

}  // namespace stgs::encoder::cuda
