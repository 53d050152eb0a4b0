// SPDX-License-Identifier: Apache-2.0
// The interface between the host and the kernels of the CUDA renderer: structs of device pointers,
// and one launch function per stage. Nothing here allocates, waits or reads back; launch errors are
// reported by cudaGetLastError(). Grid sizes do not depend on counts, which only the device knows:
// as many blocks as are resident on the GPU take work by tickets until none is left.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/render_layout.h"
#include "stgs/format/math/screen_splat.h"

namespace stgs::player::cuda {

using math::ScreenSplat;

inline constexpr int kTilePixels = 16;             // width and height, as kTileSize of raster.h
inline constexpr int kQuarterPixels = 8;           // width and height of a quarter of a tile
inline constexpr std::uint32_t kSortTile = 3072;   // keys per sort tile, sorted by one thread block
inline constexpr int kDigits = 256;                // digit values per pass of the sort
inline constexpr std::uint32_t kSelectChunks = 8;  // chunks of primitives per thread block
// Splats listed per chunk, in depth order: the first kNearChunks chunks have kNearSplats each,
// since the nearest splats touch many times more tiles than others; the rest have kListSplats each.
inline constexpr std::uint32_t kListSplats = 256, kNearSplats = 32, kNearChunks = 256;
inline constexpr int kDepthPasses = 4, kMaxPasses = 4;
inline constexpr int kMaxFrameViews = 4;  // as kMaxViews of renderer.h
// Maximum tile instances per view, the limit of the CPU rasteriser.
inline constexpr std::uint64_t kMaxInstances = std::uint64_t{1} << 26;
// The bits below this one hold the splat index. In the depth order, the bits from this one on hold
// the view; in a tile's list, the quarters of the tile that the splat meets: bit x + 2 y.
inline constexpr int kSplatBits = 28;
inline constexpr std::uint64_t kMaxSplats = std::uint64_t{1} << kSplatBits;
static_assert(kMaxFrameViews <= 1 << (32 - kSplatBits));
// Classes of list lengths, by which the blend orders its work with foveae.
inline constexpr int kPatchClasses = 4;

// Successive primitives that are rendered at the same local time.
struct Part {
  std::uint8_t* memory;  // of a PackedSegment
  double ticks;
  std::uint32_t primitives;
  std::uint32_t first_chunk;  // among the frame's chunks; parts are contiguous
};

// A viewpoint and its output.
struct ViewInput {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, world space
  math::Vec3 background;
  int width, height;  // pixels
  int tiles_x, tiles_y;
  std::uint32_t first_tile;  // among the frame's tiles; views are contiguous
  math::Vec2 fovea;          // centre, pixels
  float fovea_radius;        // pixels
  int encoding;              // of the colours (math/colour.h)
  int kernel;                // of the splats
  float* planes;             // 3 colours, alpha, depth
};

// The input of a frame, which is one time seen from all views. The parts follow it in memory.
struct alignas(16) FrameInput {
  ViewInput views[kMaxFrameViews];
  std::uint32_t view_count, parts, chunks;
};

// A primitive that may be visible at the rendered time.
struct Candidate {
  std::uint32_t part, primitive;
};

// Counts of a frame, over all views.
struct Counters {
  std::uint32_t select_ticket, project_ticket, list_ticket;
  std::uint32_t sort_tickets[2 * kMaxPasses];
  std::uint32_t active;   // candidates
  std::uint32_t visible;  // splats in total, even if they exceed the capacity
  std::uint32_t splats;   // that are sorted and listed: all, or none if they do not fit
  std::uint32_t listed;   // instances that are sorted and rendered: all, or none if they do not fit
  unsigned long long instances;               // in total, even if they exceed the capacity
  std::uint32_t patch_counts[kPatchClasses];  // tiles and squares per class
  // Only if the blend counts.
  unsigned long long evaluations;    // of a splat at a pixel
  unsigned long long contributions;  // evaluations that contribute to the pixel
};

// The buffers of a frame with up to C chunks of primitives, S splats, I instances and T tiles.
struct Workspace {
  // Cleared before each frame.
  Counters* counters = nullptr;
  std::uint32_t* depth_digits = nullptr;            // kDepthPasses x kDigits: keys with the digit
  std::uint32_t* tile_digits = nullptr;             // kMaxPasses x kDigits
  unsigned long long* select_status = nullptr;      // per kSelectChunks chunks of primitives
  unsigned long long* project_status = nullptr;     // per chunk of candidates
  unsigned long long* list_status = nullptr;        // per chunk of splats, nearest first
  std::uint32_t* sort_status[2 * kMaxPasses] = {};  // kDigits per sort tile
  uint2* tile_ranges = nullptr;                     // per tile: first and last + 1 of its instances

  Candidate* candidates = nullptr;      // C x kChunk, in id order
  ScreenSplat* splats = nullptr;        // S, ordered by id, then by view
  std::uint32_t* depth_keys[2] = {};    // S
  std::uint32_t* depth_order[2] = {};   // S; after the sort in [0]: splats, nearest first
  std::uint32_t* tile_keys[2] = {};     // I
  std::uint32_t* tile_splats[2] = {};   // I; splats with the quarters that they meet
  std::uint32_t* patches = nullptr;     // kPatchClasses x patch_capacity; see blend.cu
  std::uint32_t splat_capacity = 0;     // S
  std::uint32_t instance_capacity = 0;  // I
  std::uint32_t patch_capacity = 0;     // T, tiles
  int tile_passes = 0;                  // of the sort by tile
};

// Thread blocks that are resident on the current GPU at once.
struct Grids {
  unsigned select = 0, project_one = 0, project_several = 0;
  unsigned depth_sort = 0, list = 0, list_fovea = 0, tile_sort = 0, ranges = 0;
};
// Computes the grids. Fails if this build has no code for the current GPU.
cudaError_t find_grids(int sh_degree, Grids& grids);

// Returns the passes of the sort by tile.
int tile_passes(std::uint32_t tiles);

// Selects the primitives whose support includes the rendered time. Writes candidates and
// counters->active.
void launch_select(const FrameInput* input, const Workspace& w, const Grids& grids,
                   cudaStream_t stream);
// Motion, visibility, culling, projection and colour of the candidates, for all views at once
// (spec/representation.md, 2 to 4). Writes splats, depth_keys[0], depth_order[0], depth_digits,
// counters->visible and ->splats. `several`: there may be more than one view.
void launch_project(int sh_degree, bool several, const FrameInput* input, const Workspace& w,
                    const Grids& grids, cudaStream_t stream);
// Sorts the splats by depth, stably. Writes depth_order[0]: splat indices with the view above
// kSplatBits.
void launch_depth_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
// Lists for each splat, in depth order, the tiles of its view that its ellipse meets, with their
// quarters. Writes tile_keys[0], tile_splats[0], tile_digits, counters->instances and ->listed.
// `fovea`: there may be squares of 2 x 2 tiles at half resolution. Such a square has one list, at
// its first tile, and its tiles take the role of quarters.
void launch_list(bool fovea, const FrameInput* input, const Workspace& w, const Grids& grids,
                 cudaStream_t stream);
// Sorts the instances by tile, stably, so that each tile's are in depth order. Writes
// tile_splats[tile_passes % 2] and tile_ranges.
void launch_tile_sort(const Workspace& w, const Grids& grids, cudaStream_t stream);
struct BlendGrid {
  unsigned views = 0;
  unsigned tiles = 0, squares = 0;  // maximum over the views; squares of 2 x 2 tiles
  unsigned all_tiles = 0;           // sum over the views
  bool fovea = false;               // a view has a fovea
};
// Blends the images of all views (spec/representation.md, 5; math/fovea.h). `count`: also counts
// evaluations and contributions, which takes longer.
void launch_blend(const FrameInput* input, const BlendGrid& grid, const Workspace& w, bool count,
                  cudaStream_t stream);

}  // namespace stgs::player::cuda
