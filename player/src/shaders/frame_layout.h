// SPDX-License-Identifier: Apache-2.0
// Constants and structs that the host and the shaders share, in the common subset of C++ and GLSL
// that format/math uses. Structs contain scalars only, so that std430 lays them out as C++ does.
#ifndef STGS_PLAYER_SHADERS_FRAME_LAYOUT_H
#define STGS_PLAYER_SHADERS_FRAME_LAYOUT_H

#include "stgs/format/math/colour.h"
#include "stgs/format/math/project.h"

#if defined(GL_core_profile)
#define STGS_LAYOUT_BEGIN
#define STGS_LAYOUT_END
#else
#include <cstdint>
#define STGS_LAYOUT_BEGIN          \
  namespace stgs::player::vulkan { \
  using uint = std::uint32_t;      \
  using math::PinholeCamera;       \
  using math::Vec2;                \
  using math::Vec3;
#define STGS_LAYOUT_END }
#endif

STGS_LAYOUT_BEGIN

const int kTilePixels = 16;      // width and height, as kTileSize of raster.h
const int kQuarterPixels = 8;    // width and height of a quarter of a tile
const uint kQuarters = 4u;       // per tile; with subgroups, each subgroup blends one
const uint kGroup = 256u;        // invocations per workgroup, and primitives per chunk
const uint kSortTile = 2048u;    // keys sorted per workgroup
const uint kScanTile = 2048u;    // numbers scanned per workgroup
const uint kDigits = 256u;       // digit values per pass of the sort
const uint kCompactChunks = 4u;  // chunks compacted per workgroup
const uint kGroupsX = 32768u;    // maximum of a dispatch along x; more extend along y
const uint kMaxFrameViews = 4u;  // per frame

// In a tile's list, the bits below this one hold the splat index, enough for 16 bytes per splat in
// any buffer with a 32-bit size. The bits from this one on state which quarters of the tile the
// splat meets, or which tiles of a square at half resolution: bit x + 2 y.
const uint kSplatBits = 28u;

// Splats listed per workgroup, in depth order: the first kNearGroups workgroups list kNearSplats
// each, since the nearest splats touch many times more tiles than others; the rest list kGroup
// each.
const uint kNearGroups = 256u;
const uint kNearSplats = 32u;

// Instances per listing workgroup that are staged in shared memory for coalesced writes. A staged
// word holds the index of the splat within the workgroup in the lowest bits, then the quarters,
// then the tile. Frames with more than kMaxStagedTiles tiles do not use staging.
const uint kListStage = 1536u;
const uint kStagedMetShift = 8u, kStagedTileShift = 12u;
const uint kMaxStagedTiles = 1u << (32u - kStagedTileShift);

// Returns the first splat of a listing workgroup.
STGS_FN uint list_begin(uint group) {
  uint near = group < kNearGroups ? group : kNearGroups;
  return near * kNearSplats + (group - near) * kGroup;
}

// Returns the number of listing workgroups.
STGS_FN uint list_groups(uint splats) {
  uint near = kNearGroups * kNearSplats;
  return splats <= near ? (splats + kNearSplats - 1u) / kNearSplats
                        : kNearGroups + (splats - near + kGroup - 1u) / kGroup;
}

// Sums saturate here, above any count that can be rendered, instead of overflowing.
const uint kManyInstances = 1u << 30;

// Returns the workgroups of the sort per super group, whose digits are also counted together: about
// the square root of `groups`, so that there are no more super groups than that.
STGS_FN uint super_group_of(uint groups) {
  uint size = 1u;
  while (size * size < groups) size *= 2u;
  return size;
}

// Successive primitives in a block of memory that are rendered at the same local time.
struct Part {
  uint at;  // offset of its data in the block, in units of 16 bytes
  uint primitives;
  uint first_chunk;  // among the frame's chunks
  uint first_group;  // within the dispatch over its block
  float ticks;       // local time
  float ticks_rest;  // rounding error of ticks
};

struct ViewInput {
  PinholeCamera camera;
  Vec3 centre;  // of the camera, world space
  Vec3 background;
  int width, height;  // pixels
  int tiles_x, tiles_y;
  uint first_tile;     // among the frame's tiles, which are those of its views in sequence
  Vec2 fovea;          // centre, pixels
  float fovea_radius;  // pixels
  int encoding;        // of the colours (math/colour.h)
  int kernel;          // of the splats
};

// The input of a frame; its parts follow it. Each view has all chunks: splat s belongs to view
// s / (chunks kGroup).
struct FrameInput {
  uint views;
  uint chunks;             // per view
  uint instance_capacity;  // over all views
  uint tiles;              // over all views
  ViewInput view[kMaxFrameViews];
};

// Rows of `work`, the extents that the device computes: workgroups of an indirect dispatch along x,
// y and z, and the number of items.
const uint kWorkSortDepth = 0u;   // items: visible splats
const uint kWorkCountTiles = 1u;  // workgroups for the visible splats
const uint kWorkListTiles = 2u;   // the same
const uint kWorkSortTiles = 3u;   // listed instances
const uint kWorkFindRanges = 4u;  // listed instances
// With foveae: the patches that the blend renders, by the length of their lists.
const uint kLongPatches = 0u;
const uint kShortPatches = 1u;
const uint kPatchKinds = 2u;
const uint kWorkPatches = 5u;  // first row of one per view and kind
const uint kWorks = 5u + kPatchKinds * kMaxFrameViews;

// Counters of completed workgroups, for dispatches whose last workgroup continues alone.
const uint kEndedScanChunks = 0u;
const uint kEndedCountTiles = 1u;
const uint kEndedFindPatches = 2u;
const uint kEnded = 3u;

// Formats of the pixels that the blend writes.
const uint kPixelPlanes = 0u;  // floats, one plane per channel
const uint kPixelRgba8 = 1u;   // interleaved, for an image of the caller
const uint kPixelBgra8 = 2u;
const uint kPixelRgb10 = 3u;   // red lowest, alpha the upper two bits
const uint kPixelRgba16 = 4u;  // half floats
const uint kPixelRgba32 = 5u;

struct Push {
  uint work;                            // row of `work` with the number of items
  uint shift;                           // of the digit of a sort pass, bits
  uint super_rows;                      // first row of the super groups of a sort pass
  uint writes_ranges;                   // last pass by tile: write tile_ranges instead of keys
  uint first_part, part_count, groups;  // dispatch over a block
  uint pixels;                          // kPixel...
  uint with_depth;                      // write the depth plane besides interleaved pixels
  uint view;                            // blend
  uint patches;                         // blend with foveae: k...Patches
};

STGS_LAYOUT_END

#endif
