// SPDX-License-Identifier: Apache-2.0
// What the host's side of the CUDA renderer shares with its kernels: structs of device pointers,
// and a launch function a stage. Nothing here allocates, waits or reads back; an error of a launch
// is cudaGetLastError's. Grids do not depend on counts, which the device alone knows: the blocks
// that fit the GPU take work by tickets until there is none.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/render_layout.h"
#include "stgs/format/math/project.h"

namespace stgs::player::cuda {

inline constexpr int kTilePixels = 16;            // width and height, as kTileSize of raster.h
inline constexpr std::uint32_t kSortTile = 3072;  // keys that a thread block sorts at a time
inline constexpr int kDigits = 256;               // of a pass of the sort
inline constexpr int kDepthPasses = 4, kMostPasses = 4;
// Tile instances of a view at most; as the CPU rasteriser's limit.
inline constexpr std::uint64_t kMaxInstances = std::uint64_t{1} << 26;

// Successive primitives that are drawn at the same moment of their time.
struct Part {
  PackedSegment at;
  double ticks;
  std::uint32_t primitives;
  std::uint32_t first_chunk;  // of the view's chunks; parts follow each other
};

// What changes from frame to frame; the parts follow it.
struct alignas(16) ViewInput {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, in the world
  math::Vec3 background;
  int width, height;  // pixels
  int tiles_x, tiles_y;
  std::uint32_t parts, chunks;
};

// A visible primitive on the screen. At pixel offset (dx, dy), log2 of its alpha is
// min(most, most + dx (half_xx dx + cross dy) + half_yy dy^2).
struct alignas(16) ScreenSplat {
  float x, y;                // pixels
  float half_xx, cross;      // -log2(e) conic.xx / 2, -log2(e) conic.xy
  float half_yy, most;       // -log2(e) conic.yy / 2, log2(O_t)
  float extent_x, extent_y;  // half size of a box outside which it is not drawn, pixels
  float red, green, blue;
  float depth;  // camera z
};

// Counts of a frame. What a view leaves for the host begins with `alive`.
struct Counters {
  std::uint32_t project_ticket, list_ticket;
  std::uint32_t sort_tickets[2 * kMostPasses];
  std::uint32_t alive;           // seen at the moment, on the screen or not
  std::uint32_t visible;         // splats
  std::uint32_t listed;          // instances that are sorted and drawn: all of them, or none
  std::uint32_t unused;          // the next is 8 bytes
  unsigned long long instances;  // in all, also where they did not fit
};

// The buffers of a view with up to S splats and I instances.
struct Workspace {
  // Cleared before each view.
  Counters* counters = nullptr;
  std::uint32_t* depth_digits = nullptr;       // kDepthPasses x kDigits: how many have the digit
  std::uint32_t* tile_digits = nullptr;        // kMostPasses x kDigits
  unsigned long long* project_told = nullptr;  // a chunk of primitives
  unsigned long long* list_told = nullptr;     // a chunk of splats
  std::uint32_t* sort_told[2 * kMostPasses] = {};  // kDigits a sort tile
  uint2* tile_ranges = nullptr;                    // a tile: first and last + 1 of its instances

  ScreenSplat* splats = nullptr;        // S, in the order of ids
  std::uint32_t* depth_keys[2] = {};    // S
  std::uint32_t* depth_order[2] = {};   // S; after the sort in [0]: splats, nearest first
  std::uint32_t* tile_keys[2] = {};     // I
  std::uint32_t* tile_splats[2] = {};   // I
  std::uint32_t instance_capacity = 0;  // I
  int tile_passes = 0;                  // that the sort by tile needs
};

// Planar pictures of a view: 3 colours, alpha, depth.
struct Picture {
  float* planes = nullptr;
};

// Thread blocks that the current GPU runs at once.
struct Grids {
  unsigned project = 0, depth_sort = 0, list = 0, tile_sort = 0, ranges = 0;
};
// An error where this build has no code for the current GPU.
cudaError_t find_grids(int sh_degree, Grids& grids);

// Passes of the sort by tile for so many tiles.
int tile_passes(std::uint32_t tiles);

// Motion, visibility, culling, projection, colour of the view's parts: splats in the order of the
// parts, depth_keys[0], depth_digits, counters->alive and ->visible. spec/representation.md, 2
// to 4.
void launch_project(int sh_degree, const ViewInput* input, const Workspace& w, const Grids& grids,
                    cudaStream_t stream);
// depth_order[0]: splats by depth, equal ones in their own order.
void launch_depth_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
// For each splat by depth the tiles that its ellipse meets: tile_keys[0], tile_splats[0] and
// tile_digits; counters->instances and ->listed.
void launch_list(const ViewInput* input, const Workspace& w, const Grids& grids,
                 cudaStream_t stream);
// The instances by tile, each tile's in the order of depth, in tile_splats[tile_passes % 2];
// tile_ranges.
void launch_tile_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
// The picture, tile after tile. spec/representation.md, 5.
void launch_blend(const ViewInput* input, unsigned tiles, const Workspace& w,
                  const Picture& picture, cudaStream_t stream);

}  // namespace stgs::player::cuda
