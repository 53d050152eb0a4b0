// SPDX-License-Identifier: Apache-2.0
// A step of several ranks on GPUs: what each rank's view gives is a block of device memory, all
// blocks are gathered on every GPU, and every GPU adds them up itself, in the order of the ranks
// (backend/cpu/rank_step.h has the same for CPUs).
//
// A block is a head, then kContributionRows rows of a float for each primitive: the fields of the
// update's stage before kBasis, gradient, absolute gradient and error for densification, and 1 for
// what the view sees, else 0. The other rows hold nothing where that is 0.
#pragma once

#include <cstddef>
#include <cstdint>

#include "backend/cuda/kernels.h"
#include "train/adam.h"

namespace stgs::encoder::cuda {

inline constexpr int kMaxBlocks = 64;  // kMaxRanks, whose header is none for device code
inline constexpr int kStatisticsRow = 20, kSeenRow = 23, kContributionRows = 24;

struct RankHead {
  StepRecord record;
  float by_colour_map[12];
};
inline constexpr std::size_t kHeadBytes = 256;
static_assert(sizeof(RankHead) <= kHeadBytes);

// The blocks of all ranks, one after the other.
struct RankBlocks {
  std::uint8_t* data = nullptr;
  std::size_t bytes = 0;     // of a block
  std::uint32_t stride = 0;  // floats of a row
  int count = 1, own = 0;
};

// What every rank knows of the view of each.
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

// The first part of launch_update: rows of the own block.
void launch_contributions(const Primitives& p, const View& view, const UpdateSettings& settings,
                          const Workspace& w, const RankBlocks& blocks, cudaStream_t stream);
// The first part of launch_finish: the own block's head, counters for the next step.
void launch_head(const View& view, std::uint32_t n, const LossWeights& weights, const Workspace& w,
                 const RankBlocks& blocks, cudaStream_t stream);
// From the gathered blocks: one step of Adam with the mean gradient of the views, for what any has
// seen; statistics as if each view had been a step. Nothing where a rank had too little room.
void launch_apply(const Primitives& p, const RankViews& views, int coefficients,
                  const UpdateSettings& settings, AdamBetas betas, const RankBlocks& blocks,
                  cudaStream_t stream);
// The colour maps, a step of Adam a view in the order of the ranks; `records` (mapped host memory):
// one a rank. Where a rank had too little room, all are told so and take no step until it is
// cleared.
void launch_finish_ranks(const RankViews& views, const ColourMaps& colour, float rate,
                         Counters* counters, const RankBlocks& blocks, StepRecord* records,
                         cudaStream_t stream);

}  // namespace stgs::encoder::cuda
