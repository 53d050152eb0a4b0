// SPDX-License-Identifier: Apache-2.0
// What the host side of the CUDA backend shares with its kernels: plain structs of device pointers,
// and one launch function a stage of the step. Nothing here allocates, waits or reads back; an
// error of a launch is cudaGetLastError's after the step.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "stgs/format/math/project.h"
#include "train/random.h"
#include "train/train_state.h"

namespace stgs::encoder::cuda {

inline constexpr int kTile = 16;  // pixels, width and height; raster.h's kTileSize
inline constexpr int kSums = 12;  // floats of one splat in one tile that the backward blend adds up
inline constexpr int kSegment = 128;  // entries of a tile's list that a block of the backward takes
inline constexpr int kLossX = 32;     // pixels of a block of the image loss
inline constexpr int kLossY = 16;     //
inline constexpr int kLossSums = 13;  // of a block: L1, then the 12 gradients of the colour map
inline constexpr int kPlaneSums = 4;  // floats of one splat in one tile, by its plane
inline constexpr int kUpdateBlock = 128;  // primitives of a block of the update
// A squared weight of 1, where those of all pixels and views are added up: 2^34 of them fit.
inline constexpr double kImportanceOne = 1 << 30;
inline constexpr std::uint32_t kInvisible = 0xFFFFFFFFu;  // depth key of what is not drawn
// Tile instances of a view, at most; as the CPU rasteriser's limit.
inline constexpr std::size_t kMaxInstances = std::size_t{1} << 26;

// The parameters and what belongs to them, laid out as TrainState's arrays.
struct Primitives {
  std::uint32_t n = 0;
  int sh_coefficients = 0;       // stored
  float* values[kAttributes]{};  // TrainState::values
  float* first[kAttributes]{};   // Adam's moments
  float* second[kAttributes]{};
  float* u = nullptr;      // N x 3, effective velocity v / f
  float* sigma = nullptr;  // N, exp(log_sigma)
  // As drawn: the values, but for the coupled form, of which they are derived like u and sigma.
  float* log_scale = nullptr;  // N x 3
  float* rotation = nullptr;   // N x 4
  float* v = nullptr;          // N x 3
  float tick = 0;              // CoupledParameters::tick; 0: not in use
  std::uint32_t* updates = nullptr;
  float* gradient_sum = nullptr;  // DensifyStatistics
  float* abs_gradient_sum = nullptr;
  float* error_max = nullptr;
  std::uint32_t* views = nullptr;
};

// The colour maps of all cameras, laid out as TrainState's.
struct ColourMaps {
  std::uint32_t cameras = 0;
  float *map = nullptr, *first = nullptr, *second = nullptr;  // cameras x 12
  std::uint32_t* updates = nullptr;
};

// A visible primitive on the screen. At pixel offset (dx, dy), log2 of its alpha is
// min(most, most + dx (half_xx dx + cross dy) + half_yy dy^2).
struct alignas(16) ScreenSplat {
  float x, y;            // pixels
  float half_xx, cross;  // -log2(e) conic.xx / 2, -log2(e) conic.xy
  float half_yy, most;   // -log2(e) conic.yy / 2, log2(O_t)
  float red, green, blue;
  float extent_x, extent_y;  // half size of a box outside which it is not drawn, pixels
  float depth;               // camera z
};

struct View {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, in the world
  float ticks = 0;
  math::Vec3 background{0, 0, 0};
  float drop_share = 0;  // of the primitives, see dropped()
  Random drop_random{0, 0, RandomPurpose::kDrop};
  int coefficients = 1;  // harmonics evaluated
  int width = 0, height = 0;
  int tiles_x = 0, tiles_y = 0;
  bool planes = false;  // L_n is on: the primitives' planes are blended too
};

// Counters of the step under way.
struct Counters {
  unsigned long long instances;  // splats in tiles, also where they did not fit
  std::uint32_t visible;
  std::uint32_t overflow;  // stays 1 until the host clears it; meanwhile no step changes anything
};

// What a step leaves for the host.
struct StepRecord {
  double loss, l1, ssim, normal, perceptual;
  unsigned long long instances;
  std::uint32_t visible, overflow;
};

// The step's buffers, for N primitives, W x H pixels, T tiles, up to I tile instances and B blocks
// of the image loss. "By depth" means: entry r belongs to primitive order[r].
struct Workspace {
  Counters* counters = nullptr;
  const std::uint32_t* iota = nullptr;        // max(N, I): 0, 1, 2...
  ScreenSplat* splats = nullptr;              // N; only those of visible primitives are set
  std::uint32_t* depth_keys = nullptr;        // N, bits of the depth, or kInvisible
  std::uint32_t* depth_sorted = nullptr;      // N
  std::uint32_t* order = nullptr;             // N, primitives, nearest first, ties: lower first
  std::uint32_t* tile_counts = nullptr;       // N, by depth
  std::uint32_t* tile_masks = nullptr;        // N, by depth: tiles that it meets, of a small box
  std::uint32_t* tile_offsets = nullptr;      // N, by depth: where its instances begin
  uint2* ranges = nullptr;                    // N, its instances: begin and count
  std::uint32_t* owners = nullptr;            // I, primitive of an instance
  std::uint32_t* instance_tiles = nullptr;    // I, tile of an instance; beyond the last: ~0
  std::uint32_t* tiles_sorted = nullptr;      // I
  std::uint32_t* instances_sorted = nullptr;  // I, instances by tile, then by depth
  std::uint32_t* list = nullptr;              // I, their primitives
  std::uint32_t* tile_begin = nullptr;        // T + 1, into list
  uint2* segments = nullptr;                  // segment_count(I, T): tile and number in it, or ~0
  float4* checkpoints = nullptr;              // for each segment, 256: picture in front of it
  float* partials = nullptr;                  // I x kSums, by instance
  float4* image = nullptr;                    // W x H: colour, transmittance
  std::uint32_t* last = nullptr;              // W x H: length of the tile's list that is drawn
  float* slopes = nullptr;                    // 9 x W x H
  float* error = nullptr;                     // W x H, 1 - SSIM
  float4* d_image = nullptr;                  // W x H: dL/dcolour, error
  float* ssim_sums = nullptr;                 // B
  float* loss_sums = nullptr;                 // kLossSums x B
  double* regulariser_sums = nullptr;         // one a block of the update
  const double* perceptual = nullptr;         // L_lpips of the step, where it is on
  // Where L_n is on. A plane (math/surface.h) or a gradient by one: normal x, y, z, distance.
  float4* planes = nullptr;               // N; only those of visible primitives are set
  float4* surface = nullptr;              // W x H, the planes' blend
  float4* surface_checkpoints = nullptr;  // as checkpoints
  float4* d_surface = nullptr;            // W x H, dL/dsurface
  float4* plane_partials = nullptr;       // I, by instance
  std::uint32_t* difference_range =
      nullptr;                   // 2: largest picture_difference and largest lack of it
  float* normal_sums = nullptr;  // B
  void* sort_memory = nullptr;
  std::size_t sort_bytes = 0;
};

// Tile t's lists are cut into segments with numbers from first_segment on, which leave gaps but
// never meet, so that no count has to be known.
__host__ __device__ inline std::uint32_t first_segment(std::uint32_t tile_begin,
                                                       std::uint32_t tile) {
  return tile_begin / kSegment + tile;
}
// More than any segment's number.
inline std::size_t segment_count(std::size_t instances, std::size_t tiles) {
  return instances / kSegment + tiles + 1;
}

struct LossWeights {
  float l1, ssim, normal, perceptual;
};

struct UpdateSettings {
  bool modulated, learn_radius, second_stage, gather_statistics;
  math::DampingRules damping;
  float rates[kAttributes];
  float rate_sh0;
  float weight_lifespan, weight_opacity, weight_scale;
};

// Bytes of Workspace::sort_memory for sorting `items` and for summing over them.
std::size_t sort_memory_bytes(std::size_t items);

// cudaSuccess where this build has code for the current GPU.
cudaError_t kernels_loadable();

// Fills `iota` with 0 .. n-1.
void launch_iota(std::uint32_t* iota, std::size_t n, cudaStream_t stream);
// 0 .. n-1 in ascending order of the low `bits` of their keys; equal ones in their own order.
void sort_indices(const Workspace& w, const std::uint32_t* keys, std::uint32_t* keys_sorted,
                  std::uint32_t* indices, std::size_t n, int bits, cudaStream_t stream);
// sums[i]: of the values before i.
void sum_before(const Workspace& w, const std::uint32_t* values, std::uint32_t* sums, std::size_t n,
                cudaStream_t stream);
// Motion, visibility, culling, projection, colour: splats, planes, depth_keys, counters->visible.
void launch_slice(const Primitives& p, const View& view, const Workspace& w, cudaStream_t stream);
// Tile lists as stgs::bin makes them, for up to `bound` instances; more set counters->overflow.
void launch_bin(std::uint32_t n, const View& view, std::size_t bound, const Workspace& w,
                cudaStream_t stream);
// picture, last, segments and checkpoints; surface and its checkpoints.
void launch_blend(const View& view, const Workspace& w, cudaStream_t stream);
// Adds to `sums`, one a primitive, its squared weights at the pixels of the view, times
// kImportanceOne (train/importance.h). As integers, so that the order of adding does not matter.
void launch_importance(const View& view, unsigned long long* sums, const Workspace& w,
                       cudaStream_t stream);
// d_picture, ssim_sums and loss_sums, for the picture shown through `colour_map` (12 floats);
// truth: W x H x 3 bytes.
void launch_image_loss(const View& view, const std::uint8_t* truth, const float* colour_map,
                       const LossWeights& weights, const Workspace& w, cudaStream_t stream);
// d_surface and normal_sums (train/normal_loss.h), where L_n is on.
void launch_normal_loss(const View& view, const std::uint8_t* truth, float weight,
                        const Workspace& w, cudaStream_t stream);
// partials and plane_partials of every instance.
void launch_blend_backward(const View& view, std::size_t bound, const Workspace& w,
                           cudaStream_t stream);
// Gradients by the parameters of the visible primitives, regularisers, statistics and Adam.
void launch_update(const Primitives& p, const View& view, const UpdateSettings& settings,
                   const Workspace& w, cudaStream_t stream);
// What is drawn of every primitive in the coupled form; wherever its values have changed, so that
// it always comes from this one kernel and does not depend on where a run was resumed.
void launch_derive_coupled(const Primitives& p, cudaStream_t stream);
// The losses into `record` (mapped host memory), Adam on colour map `index`, counters for the next.
void launch_finish(const View& view, std::uint32_t n, const LossWeights& weights,
                   const ColourMaps& colour, std::uint32_t index, float rate, StepRecord* record,
                   const Workspace& w, cudaStream_t stream);

// Blocks of a grid over so many items; one where there are none, since no grid may be empty.
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
