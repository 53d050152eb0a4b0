// SPDX-License-Identifier: Apache-2.0
// The interface between the host code of the CUDA backend and its kernels: plain structs of device
// pointers, and one launch function per stage of a step. Nothing here allocates, waits or reads
// back. Check cudaGetLastError() after the step for launch errors.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "math/lens.h"
#include "math/short_lived.h"
#include "stgs/format/math/screen_splat.h"
#include "train/random.h"
#include "train/rounding.h"
#include "train/train_state.h"

namespace stgs::encoder::cuda {

using math::ScreenSplat;

inline constexpr int kTile = 16;      // pixels, width and height; raster.h's kTileSize
inline constexpr int kSums = 12;      // floats per splat and tile that the backward blend sums
inline constexpr int kSegment = 128;  // entries of a tile's list per block of the backward blend
inline constexpr int kLossX = 32;     // width and height of a block of the image loss, pixels
inline constexpr int kLossY = 16;
// Sums per block of the image loss: L1, the 12 gradients of the colour map, squared differences.
inline constexpr int kLossSums = 14;
inline constexpr int kPlaneSums = 4;       // floats per splat and tile: the gradient of its plane
inline constexpr int kUpdateBlock = 128;   // primitives per block of the update
inline constexpr int kBinPrimitives = 64;  // primitives per block of the binning
inline constexpr int kLensBlocks = 64;     // of the sum of the vignetting's gradient
inline constexpr int kCameraValues = 9;    // of a camera's gradient (math/camera_grad.h), in order
// Fixed-point value of a squared weight of 1. The sum over all pixels and views holds 2^34 of them.
inline constexpr double kImportanceOne = 1 << 30;
inline constexpr std::uint32_t kInvisible = 0xFFFFFFFFu;  // depth key of invisible primitives
// Maximum number of tile instances of a view; the limit of the CPU rasteriser.
inline constexpr std::size_t kMaxInstances = std::size_t{1} << 26;

// The values that a view renders: those of Primitives, or rounded copies of them (quantise.cu).
struct Rendered {
  const float* position = nullptr;   // N x 3
  const float* log_scale = nullptr;  // N x 3
  const float* rotation = nullptr;   // N x 4
  const float* opacity = nullptr;    // N, logits
  const float* sh = nullptr;         // N x 3 sh_coefficients
  const float* u = nullptr;          // N x 3
};

// The parameters, moments and statistics of all primitives, laid out like TrainState's arrays.
struct Primitives {
  std::uint32_t n = 0;
  int sh_coefficients = 0;       // stored
  float* values[kAttributes]{};  // TrainState::values
  float* first[kAttributes]{};   // Adam's moments
  float* second[kAttributes]{};
  float* u = nullptr;      // N x 3, effective velocity v / f
  float* sigma = nullptr;  // N, exp(log_sigma)
  // The values above, except in the coupled form, which derives them like u and sigma.
  float* log_scale = nullptr;  // N x 3
  float* rotation = nullptr;   // N x 4
  Rendered rendered;
  const RoundingRules* rules = nullptr;  // device memory; null: not rounding
  const std::uint8_t* tier = nullptr;    // N, if rounding
  float* v = nullptr;                    // N x 3
  float tick = 0;                        // CoupledParameters::tick; 0: not in use
  std::uint32_t* updates = nullptr;
  std::uint32_t fixed = 0;        // number of fixed primitives (kFixed)
  float* gradient_sum = nullptr;  // DensifyStatistics
  float* abs_gradient_sum = nullptr;
  float* error_max = nullptr;
  std::uint32_t* views = nullptr;
};

// Memory for the rounded values, laid out like Rendered.
struct RoundedValues {
  float *position = nullptr, *log_scale = nullptr, *rotation = nullptr, *opacity = nullptr,
        *sh = nullptr, *u = nullptr;
};

// The colour maps of all cameras, laid out like TrainState's.
struct ColourMaps {
  std::uint32_t cameras = 0;
  float *map = nullptr, *first = nullptr, *second = nullptr;  // cameras x 12
  std::uint32_t* updates = nullptr;
};

// The background of a view.
struct Background {
  math::Vec3 colour{0, 0, 0};
  // Not null: the colour is that of the image after this colour map, in device memory.
  const float* map = nullptr;
};

struct View {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, world space
  float ticks = 0;
  Background background;
  float drop_share = 0;  // fraction of the primitives to drop, see dropped()
  Random drop_random{0, 0, RandomPurpose::kDrop};
  int coefficients = 1;  // SH coefficients evaluated
  int kernel = 0;        // of the splats
  int width = 0, height = 0;
  int tiles_x = 0, tiles_y = 0;
  bool planes = false;  // L_n is on; the primitives' planes are blended too
  bool gather_camera = false;
};

// Counters of the step in flight.
struct Counters {
  unsigned long long instances;  // tile instances, including those that did not fit
  std::uint32_t visible;
  std::uint32_t overflow;  // 1 until the host clears it; steps have no effect meanwhile
};

// The results of a step for the host.
struct StepRecord {
  double loss, l1, mse, ssim, normal, perceptual;
  unsigned long long instances;
  std::uint32_t visible, overflow;
  // Gradients of the camera and of its vignetting, if they are gathered.
  float camera[kCameraValues], vignetting;
};

// The buffers of a step, for N primitives, W x H pixels, T tiles, up to I tile instances and B
// blocks of the image loss. Densification uses some of them between steps.
struct Workspace {
  Counters* counters = nullptr;
  const std::uint32_t* iota = nullptr;  // N: 0, 1, 2...
  ScreenSplat* splats = nullptr;        // N; only those of visible primitives are set
  std::uint32_t* depth_keys = nullptr;  // N, bits of the depth, or kInvisible
  std::uint32_t *keys_sorted = nullptr, *order = nullptr, *flags = nullptr,
                *offsets = nullptr;           // N, of densification
  std::uint32_t* block_begin = nullptr;       // N / kBinPrimitives, rounded up: first instance
  uint2* ranges = nullptr;                    // N, its instances: first and count
  std::uint32_t* tile_entries = nullptr;      // T, entries of its list so far; 0 between steps
  unsigned long long* entry_keys = nullptr;   // I, by tile: depth, then primitive
  std::uint32_t* instances_sorted = nullptr;  // I, instances sorted by tile, then by depth
  std::uint32_t* list = nullptr;              // I, their primitives
  std::uint32_t* tile_begin = nullptr;        // T + 1, into list
  uint2* segments = nullptr;                  // segment_count(I, T): tile and index in it, or ~0
  float4* checkpoints = nullptr;              // 256 per segment: image in front of it
  float* partials = nullptr;                  // I x kSums, by instance
  float4* sums = nullptr;                     // N x kSums / 4: the partials, summed
  float4* image = nullptr;                    // W x H: colour, transmittance
  std::uint32_t* last = nullptr;       // W x H: number of list entries up to the last rendered
  float* slopes = nullptr;             // 9 x W x H
  float* error = nullptr;              // W x H, 1 - SSIM
  float4* d_image = nullptr;           // W x H: dL/dcolour, error
  float* ssim_sums = nullptr;          // B
  float* loss_sums = nullptr;          // kLossSums x B
  double* regulariser_sums = nullptr;  // one per block of the update
  const double* perceptual = nullptr;  // L_lpips of the step, if it is on
  // kCameraValues for the view, then for each block of the update; only if gathered.
  float* camera_sums = nullptr;
  float* lens_sums = nullptr;            // 1 + kLensBlocks: dL/dv, then its parts
  std::uint8_t* without_lens = nullptr;  // W x H x 3, the training image of undo_lens.h
  // Used if L_n is on. A plane (math/surface.h) or its gradient: normal x, y, z, distance.
  float4* planes = nullptr;               // N; only those of visible primitives are set
  float4* surface = nullptr;              // W x H, blended planes
  float4* surface_checkpoints = nullptr;  // like checkpoints
  float4* d_surface = nullptr;            // W x H, dL/dsurface
  float4* plane_partials = nullptr;       // I, by instance
  float4* plane_sums = nullptr;           // N
  std::uint32_t* difference_range =
      nullptr;                   // 2: encoded range of the image differences, see normal_loss.cu
  float* normal_sums = nullptr;  // B
  void* sort_memory = nullptr;
  std::size_t sort_bytes = 0;
};

// Returns the index of the first segment of a tile's list. The index ranges of the tiles never
// overlap, but have gaps, so that no segment has to be counted.
__host__ __device__ inline std::uint32_t first_segment(std::uint32_t tile_begin,
                                                       std::uint32_t tile) {
  return tile_begin / kSegment + tile;
}
// Returns an upper bound of the segment indices.
inline std::size_t segment_count(std::size_t instances, std::size_t tiles) {
  return instances / kSegment + tiles + 1;
}

struct LossWeights {
  float l1, ssim, normal, perceptual;
};

struct UpdateSettings {
  bool modulated, learn_radius, second_stage, gather_statistics;
  math::DampingRules damping;
  math::ShortLivedRules short_lived;
  float rates[kAttributes];
  float rate_sh0;
  float weight_lifespan, weight_opacity, weight_scale, weight_rate;  // the last only if rounding
};

// Returns the size of Workspace::sort_memory for sorting and scanning `items`, bytes.
std::size_t sort_memory_bytes(std::size_t items);

// Returns cudaSuccess if this build has code for the current GPU.
cudaError_t kernels_loadable();

// Fills `iota` with 0 .. n-1.
void launch_iota(std::uint32_t* iota, std::size_t n, cudaStream_t stream);
// Sorts 0 .. n-1 by the low `bits` of their keys, ascending and stable.
void sort_indices(const Workspace& w, const std::uint32_t* keys, std::uint32_t* keys_sorted,
                  std::uint32_t* indices, std::size_t n, int bits, cudaStream_t stream);
// Computes the exclusive prefix sums of the values.
void exclusive_sum(const Workspace& w, const std::uint32_t* values, std::uint32_t* sums,
                   std::size_t n, cudaStream_t stream);
// Evaluates motion, visibility, culling, projection and colour. Writes splats, planes, depth_keys
// and counters->visible.
void launch_slice(const Primitives& p, const View& view, const Workspace& w, cudaStream_t stream);
// Builds the tile lists of stgs::bin for up to `bound` instances; more set counters->overflow.
void launch_bin(std::uint32_t n, const View& view, std::size_t bound, const Workspace& w,
                cudaStream_t stream);
// Blends: writes image, last, segments and checkpoints; surface and its checkpoints.
void launch_blend(const View& view, const Workspace& w, cudaStream_t stream);
// As TrainBackend::limit_scales, on the learnt values. `cameras`: device memory.
void launch_limit_scales(const Primitives& p, const math::PinholeCamera* cameras,
                         std::uint32_t count, float pixels, cudaStream_t stream);
// Adds each primitive's squared blend weights at the pixels of the view, times kImportanceOne, to
// `sums` (train/importance.h). The sums are integers, so the order of summation does not matter.
void launch_importance(const View& view, unsigned long long* sums, const Workspace& w,
                       cudaStream_t stream);
// Computes d_image, ssim_sums and loss_sums of the image corrected by `colour_map` (12 floats).
// ground_truth: W x H x 3 bytes.
void launch_image_loss(const View& view, const std::uint8_t* ground_truth, const float* colour_map,
                       const LossWeights& weights, const Workspace& w, cudaStream_t stream);
// Computes d_surface and normal_sums (train/normal_loss.h). Only if L_n is on.
void launch_normal_loss(const View& view, const std::uint8_t* ground_truth, float weight,
                        const Workspace& w, cudaStream_t stream);
// Computes partials and plane_partials of every instance.
void launch_blend_backward(const View& view, std::size_t bound, const Workspace& w,
                           cudaStream_t stream);
// Sums the partials and plane_partials of each visible primitive; without View::gather_camera not
// of fixed ones.
void launch_sum_instances(const Primitives& p, const View& view, const Workspace& w,
                          cudaStream_t stream);
// Computes the gradient of the camera into camera_sums. Only if View::gather_camera.
void launch_camera_gradient(const Primitives& p, const View& view, const Workspace& w,
                            cudaStream_t stream);
// Computes w.without_lens from a training image.
void launch_undo_lens(const View& view, const math::Lens& lens, const std::uint8_t* image,
                      const Workspace& w, cudaStream_t stream);
// Computes the gradient of the vignetting into lens_sums, from d_image.
void launch_vignetting_gradient(const View& view, const Workspace& w, cudaStream_t stream);
// Updates the visible primitives: gradients of the parameters, regularisers, statistics and Adam.
void launch_update(const Primitives& p, const View& view, const UpdateSettings& settings,
                   const Workspace& w, cudaStream_t stream);
// Derives the rendered values of all primitives in the coupled form. Runs after every change of the
// learnt values, so that they always come from this kernel, wherever a run was resumed.
void launch_derive_coupled(const Primitives& p, cudaStream_t stream);
// Rounds the learnt values of all primitives to those that a decoder reconstructs.
void launch_rounding(const Primitives& p, const RoundedValues& out, cudaStream_t stream);
// Writes the losses to `record` (mapped host memory), applies Adam to colour map `index`, and
// resets the counters for the next step.
void launch_finish(const View& view, std::uint32_t n, const LossWeights& weights,
                   const ColourMaps& colour, std::uint32_t index, float rate, StepRecord* record,
                   const Workspace& w, cudaStream_t stream);

// Returns the number of blocks over `items`; 1 if there are none, because a grid must not be empty.
inline int blocks_of(std::size_t items, int block) {
  const std::size_t size = static_cast<std::size_t>(block);
  return items == 0 ? 1 : static_cast<int>((items + size - 1) / size);
}
inline int loss_blocks_x(const View& view) {
  return (view.width + kLossX - 1) / kLossX;
}
inline int loss_blocks_y(const View& view) {
  return (view.height + kLossY - 1) / kLossY;
}
inline std::size_t loss_blocks(int width, int height) {
  return std::size_t{1} * ((width + kLossX - 1) / kLossX) * ((height + kLossY - 1) / kLossY);
}

}  // namespace stgs::encoder::cuda
