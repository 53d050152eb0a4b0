// SPDX-License-Identifier: Apache-2.0
// The end of a step: the losses for the host, and the colour maps.
#include "backend/cuda/device.cuh"
#include "backend/cuda/rank_blocks.h"

namespace stgs::encoder::cuda {
namespace {

// Those of the image loss, SSIM, L_n, regularisers.
constexpr int kFloatQuantities = kLossSums + 2, kQuantities = kFloatQuantities + 1;
constexpr int kBlock = 512;
constexpr int kMapSize = 12;
static_assert(kLossSums == kMapSize + 2);

struct FinishArguments {
  Counters* counters;
  const float *loss_sums, *ssim_sums, *normal_sums;  // the last is null if L_n is off
  const double *regulariser_sums, *perceptual;
  const float *camera, *vignetting;  // null if not gathered
  std::uint32_t loss_blocks, update_blocks;
  double values;  // pixels times channels
  LossWeights weights;
  ColourMaps colour;
  std::uint32_t index;
  float rate;
  StepRecord* record;
};

// Sums all quantities over their blocks, in an order that depends only on the numbers of blocks.
__device__ void sum_all(const FinishArguments& a, double (&sums)[kQuantities]) {
  __shared__ double warps[kQuantities][kBlock / 32];
  // Each thread sums a few blocks, in float like the sums of the blocks themselves, which is
  // faster.
  float own[kFloatQuantities] = {};
  double regularisers = 0.0;
  for (std::uint32_t k = threadIdx.x; k < a.loss_blocks; k += kBlock) {
#pragma unroll
    for (int q = 0; q < kLossSums; ++q) own[q] += a.loss_sums[q * a.loss_blocks + k];
    own[kLossSums] += a.ssim_sums[k];
    if (a.normal_sums != nullptr) own[kLossSums + 1] += a.normal_sums[k];
  }
  for (std::uint32_t k = threadIdx.x; k < a.update_blocks; k += kBlock)
    regularisers += a.regulariser_sums[k];
#pragma unroll
  for (int q = 0; q < kQuantities; ++q) {
    const double sum =
        warp_sum(q < kFloatQuantities ? double{own[min(q, kFloatQuantities - 1)]} : regularisers);
    if ((threadIdx.x & 31) == 0) warps[q][threadIdx.x / 32] = sum;
  }
  __syncthreads();
  if (threadIdx.x < kQuantities) {
    double sum = 0.0;
    for (double part : warps[threadIdx.x]) sum += part;
    sums[threadIdx.x] = sum;
  }
  __syncthreads();
}

__device__ void write_record(const FinishArguments& a, const double* sums) {
  StepRecord record;
  record.overflow = a.counters->overflow;
  record.instances = a.counters->instances;
  record.visible = a.counters->visible;
  record.l1 = sums[0] / a.values;
  record.mse = sums[1 + kMapSize] / a.values;
  record.ssim = sums[kLossSums] / a.values;
  record.normal = 3.0 * sums[kLossSums + 1] / a.values;
  record.perceptual = a.weights.perceptual > 0 ? *a.perceptual : 0.0;
  record.loss = a.weights.l1 * record.l1 + a.weights.ssim * (1.0 - record.ssim) +
                a.weights.normal * record.normal + a.weights.perceptual * record.perceptual;
  if (record.visible > 0) record.loss += sums[kFloatQuantities] / record.visible;
  for (int k = 0; k < kCameraValues; ++k) record.camera[k] = a.camera ? a.camera[k] : 0.0f;
  record.vignetting = a.vignetting ? *a.vignetting : 0.0f;
  *a.record = record;
  a.counters->instances = 0;
  a.counters->visible = 0;
}

// Updates entry k of the colour maps: Adam for camera `index`, then shifts all cameras so that
// their mean is the identity.
__device__ void update_colour(const ColourMaps& colour, std::uint32_t index, int k, float gradient,
                              float rate, AdamFactors factors) {
  const std::size_t at = std::size_t{kMapSize} * index + k;
  colour.map[at] =
      adam(colour.map[at], colour.first[at], colour.second[at], gradient, rate, factors);
  float mean = 0.0f;
  for (std::uint32_t c = 0; c < colour.cameras; ++c) mean += colour.map[kMapSize * c + k];
  const float identity = k < 9 && k % 4 == 0 ? 1.0f : 0.0f;
  const float excess = mean / static_cast<float>(colour.cameras) - identity;
  for (std::uint32_t c = 0; c < colour.cameras; ++c) colour.map[kMapSize * c + k] -= excess;
}

__global__ void __launch_bounds__(kBlock) finish(const FinishArguments a) {
  __shared__ double sums[kQuantities];
  const bool overflow = a.counters->overflow != 0;
  sum_all(a, sums);
  if (threadIdx.x >= 32) return;
  const std::uint32_t updates = a.colour.updates[a.index] + 1;
  __syncwarp();
  if (threadIdx.x < kMapSize && !overflow)
    update_colour(a.colour, a.index, static_cast<int>(threadIdx.x),
                  static_cast<float>(sums[1 + threadIdx.x]), a.rate, adam_factors(updates));
  if (threadIdx.x != 0) return;
  if (!overflow) a.colour.updates[a.index] = updates;
  write_record(a, sums);
}

__global__ void __launch_bounds__(kBlock) write_head(const FinishArguments a, float* by_map) {
  __shared__ double sums[kQuantities];
  sum_all(a, sums);
  if (threadIdx.x < kMapSize) by_map[threadIdx.x] = static_cast<float>(sums[1 + threadIdx.x]);
  if (threadIdx.x == 0) write_record(a, sums);
}

// One thread per entry of the maps.
__global__ void finish_ranks(const RankViews views, const ColourMaps colour, float rate,
                             Counters* counters, const RankBlocks blocks, StepRecord* records) {
  const int k = static_cast<int>(threadIdx.x);
  bool overflow = false;
  for (int r = 0; r < blocks.count; ++r)
    overflow = overflow || rank_head(blocks, r)->record.overflow != 0;
  for (int r = 0; r < blocks.count && !overflow; ++r) {
    const RankHead* head = rank_head(blocks, r);
    const std::uint32_t index = views.colour_index[r];
    const std::uint32_t updates = colour.updates[index] + 1;
    __syncwarp();
    if (k < kMapSize)
      update_colour(colour, index, k, head->by_colour_map[k], rate, adam_factors(updates));
    if (k == 0) colour.updates[index] = updates;
    __syncwarp();
  }
  for (int r = k; r < blocks.count; r += 32) {
    StepRecord record = rank_head(blocks, r)->record;
    record.overflow = overflow;
    records[r] = record;
  }
  if (k == 0 && overflow) counters->overflow = 1;
}

// Returns the arguments without the colour maps, camera index and rate.
FinishArguments make_arguments(const View& view, std::uint32_t n, const LossWeights& weights,
                               const Workspace& w, StepRecord* record) {
  FinishArguments a{};
  a.counters = w.counters;
  a.loss_sums = w.loss_sums;
  a.ssim_sums = w.ssim_sums;
  a.normal_sums = view.planes ? w.normal_sums : nullptr;
  a.regulariser_sums = w.regulariser_sums;
  a.perceptual = w.perceptual;
  a.camera = view.gather_camera ? w.camera_sums : nullptr;
  a.vignetting = view.gather_camera ? w.lens_sums : nullptr;
  a.loss_blocks = static_cast<std::uint32_t>(loss_blocks(view.width, view.height));
  a.update_blocks = static_cast<std::uint32_t>(blocks_of(n, kUpdateBlock));
  a.values = 3.0 * view.width * view.height;
  a.weights = weights;
  a.record = record;
  return a;
}

}  // namespace

void launch_finish(const View& view, std::uint32_t n, const LossWeights& weights,
                   const ColourMaps& colour, std::uint32_t index, float rate, StepRecord* record,
                   const Workspace& w, cudaStream_t stream) {
  FinishArguments arguments = make_arguments(view, n, weights, w, record);
  arguments.colour = colour;
  arguments.index = index;
  arguments.rate = rate;
  finish<<<1, kBlock, 0, stream>>>(arguments);
}

void launch_head(const View& view, std::uint32_t n, const LossWeights& weights, const Workspace& w,
                 const RankBlocks& blocks, cudaStream_t stream) {
  RankHead* head = rank_head(blocks, blocks.own);
  write_head<<<1, kBlock, 0, stream>>>(make_arguments(view, n, weights, w, &head->record),
                                       head->by_colour_map);
}

void launch_finish_ranks(const RankViews& views, const ColourMaps& colour, float rate,
                         Counters* counters, const RankBlocks& blocks, StepRecord* records,
                         cudaStream_t stream) {
  finish_ranks<<<1, 32, 0, stream>>>(views, colour, rate, counters, blocks, records);
}

}  // namespace stgs::encoder::cuda
