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

inline constexpr int kTilePixels = 16;             // width and height, as kTileSize of raster.h
inline constexpr int kQuarterPixels = 8;           // of a quarter of a tile
inline constexpr std::uint32_t kSortTile = 3072;   // keys that a thread block sorts at a time
inline constexpr int kDigits = 256;                // of a pass of the sort
inline constexpr std::uint32_t kSelectChunks = 8;  // of primitives, that a thread block looks at
// Splats that a thread block lists at a time, in the order of depth: few of the nearest, which have
// many times the tiles of others and would keep all waiting for their block.
inline constexpr std::uint32_t kListSplats = 256, kNearSplats = 32, kNearChunks = 256;
inline constexpr int kDepthPasses = 4, kMostPasses = 4;
inline constexpr int kMostViews = 4;  // as kMaxViews of renderer.h
// Tile instances of a view at most; as the CPU rasteriser's limit.
inline constexpr std::uint64_t kMaxInstances = std::uint64_t{1} << 26;
// A splat's number has the bits below this one. Those from it on tell of its view in the order of
// depth, and in a tile's list which of the tile's quarters it meets: bit x + 2 y.
inline constexpr int kSplatBits = 28;
inline constexpr std::uint64_t kMaxSplats = std::uint64_t{1} << kSplatBits;
static_assert(kMostViews <= 1 << (32 - kSplatBits));
// Of what the blend takes by the lengths of lists, where there are foveae.
inline constexpr int kPatchClasses = 4;

// Successive primitives that are drawn at the same moment of their time.
struct Part {
  std::uint8_t* memory;  // of a PackedSegment
  double ticks;
  std::uint32_t primitives;
  std::uint32_t first_chunk;  // of the frame's chunks; parts follow each other
};

// A viewpoint and where its picture goes.
struct ViewInput {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, in the world
  math::Vec3 background;
  int width, height;  // pixels
  int tiles_x, tiles_y;
  std::uint32_t first_tile;  // of the frame's tiles; views follow each other
  math::Vec2 fovea;          // its centre, pixels
  float fovea_radius;        // pixels
  float* planes;             // 3 colours, alpha, depth
};

// What changes from frame to frame; the parts follow it. A frame is one moment from all its views.
struct alignas(16) FrameInput {
  ViewInput views[kMostViews];
  std::uint32_t view_count, parts, chunks;
};

// A primitive that may be seen at the moment.
struct Candidate {
  std::uint32_t part, primitive;
};

// A primitive that is visible in a view, on its screen. At pixel offset (dx, dy), log2 of its alpha
// is min(most, most + dx (half_xx dx + cross dy) + half_yy dy^2).
struct alignas(16) ScreenSplat {
  float x, y;                // pixels
  float half_xx, cross;      // -log2(e) conic.xx / 2, -log2(e) conic.xy
  float half_yy, most;       // -log2(e) conic.yy / 2, log2(O_t)
  float extent_x, extent_y;  // half size of a box outside which it is not drawn, pixels
  float red, green, blue;
  float depth;  // camera z
};

// Counts of a frame, over all its views.
struct Counters {
  std::uint32_t select_ticket, project_ticket, list_ticket;
  std::uint32_t sort_tickets[2 * kMostPasses];
  std::uint32_t alive;           // candidates
  std::uint32_t visible;         // splats in all, also where they did not fit
  std::uint32_t splats;          // that are sorted and listed: all of them, or none
  std::uint32_t listed;          // instances that are sorted and drawn: all of them, or none
  unsigned long long instances;  // of the splats in all, also where they did not fit
  std::uint32_t patch_counts[kPatchClasses];  // tiles and squares with lists of such a length
  // Only where the blend counts.
  unsigned long long evaluations;    // of a splat at a pixel
  unsigned long long contributions;  // of these: to the pixel's colour
};

// The buffers of a frame with up to C chunks of primitives, S splats, I instances and T tiles.
struct Workspace {
  // Cleared before each frame.
  Counters* counters = nullptr;
  std::uint32_t* depth_digits = nullptr;       // kDepthPasses x kDigits: how many have the digit
  std::uint32_t* tile_digits = nullptr;        // kMostPasses x kDigits
  unsigned long long* select_told = nullptr;   // kSelectChunks chunks of primitives
  unsigned long long* project_told = nullptr;  // a chunk of candidates
  unsigned long long* list_told = nullptr;     // a chunk of splats, nearest first
  std::uint32_t* sort_told[2 * kMostPasses] = {};  // kDigits a sort tile
  uint2* tile_ranges = nullptr;                    // a tile: first and last + 1 of its instances

  Candidate* candidates = nullptr;      // C x kChunk, in the order of ids
  ScreenSplat* splats = nullptr;        // S, in the order of ids, then of views
  std::uint32_t* depth_keys[2] = {};    // S
  std::uint32_t* depth_order[2] = {};   // S; after the sort in [0]: splats, nearest first
  std::uint32_t* tile_keys[2] = {};     // I
  std::uint32_t* tile_splats[2] = {};   // I; splats with the quarters that they meet
  std::uint32_t* patches = nullptr;     // kPatchClasses x patch_capacity; see blend.cu
  std::uint32_t splat_capacity = 0;     // S
  std::uint32_t instance_capacity = 0;  // I
  std::uint32_t patch_capacity = 0;     // T, tiles
  int tile_passes = 0;                  // that the sort by tile needs
};

// Thread blocks that the current GPU runs at once.
struct Grids {
  unsigned select = 0, project_one = 0, project_several = 0;
  unsigned depth_sort = 0, list = 0, list_fovea = 0, tile_sort = 0, ranges = 0;
};
// An error where this build has no code for the current GPU.
cudaError_t find_grids(int sh_degree, Grids& grids);

// Passes of the sort by tile for so many tiles.
int tile_passes(std::uint32_t tiles);

// Which primitives of the parts may be seen at the moment, by their supports alone: candidates,
// counters->alive.
void launch_select(const FrameInput* input, const Workspace& w, const Grids& grids,
                   cudaStream_t stream);
// Motion, visibility, culling, projection, colour of the candidates, for all views at once: splats,
// depth_keys[0], depth_order[0], depth_digits, counters->visible and ->splats. `several`: there may
// be more than one view. spec/representation.md, 2 to 4.
void launch_project(int sh_degree, bool several, const FrameInput* input, const Workspace& w,
                    const Grids& grids, cudaStream_t stream);
// depth_order[0]: splats, with their views above kSplatBits, by depth; equal ones in their own
// order.
void launch_depth_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
// For each splat by depth the tiles of its view that its ellipse meets, with their quarters:
// tile_keys[0], tile_splats[0] and tile_digits; counters->instances and ->listed. `fovea`: there
// may be squares of 2 x 2 tiles at half resolution. Such a square has one list, under its first
// tile, and for quarters its tiles.
void launch_list(bool fovea, const FrameInput* input, const Workspace& w, const Grids& grids,
                 cudaStream_t stream);
// The instances by tile, each tile's in the order of depth, in tile_splats[tile_passes % 2];
// tile_ranges.
void launch_tile_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
struct BlendGrid {
  unsigned views = 0;
  unsigned tiles = 0, squares = 0;  // of a view at most; squares of 2 x 2 tiles
  unsigned all_tiles = 0;           // of all views
  bool fovea = false;               // whether a view has one
};
// The pictures of all views. spec/representation.md, 5; math/fovea.h. `count`: what it does too,
// which takes longer.
void launch_blend(const FrameInput* input, const BlendGrid& grid, const Workspace& w, bool count,
                  cudaStream_t stream);

}  // namespace stgs::player::cuda
