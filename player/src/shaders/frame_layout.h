// SPDX-License-Identifier: Apache-2.0
// What the host's side of the Vulkan renderer shares with its shaders, in the subset of
// format/math: structs of scalars, which std430 lays out as C++ does.
#ifndef STGS_PLAYER_SHADERS_FRAME_LAYOUT_H
#define STGS_PLAYER_SHADERS_FRAME_LAYOUT_H

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
const int kQuarterPixels = 8;    // of a quarter of a tile
const uint kQuarters = 4u;       // of a tile; where subgroups are known, each blends one
const uint kGroup = 256u;        // invocations of a workgroup, and primitives of a chunk
const uint kSortTile = 2048u;    // keys that a workgroup sorts
const uint kScanTile = 2048u;    // numbers that a workgroup sums
const uint kDigits = 256u;       // of a pass of the sort
const uint kCompactChunks = 4u;  // whose keys a workgroup writes
const uint kGroupsX = 32768u;    // of a dispatch along x; more go along y
const uint kMostViews = 4u;      // of a frame

// In a tile's list a splat's number has the bits below this one, enough for 16 bytes a splat in any
// buffer, whose bytes 32 bits count. Those from it on tell which of the tile's quarters it meets,
// or of a square at half resolution which tiles: bit x + 2 y.
const uint kSplatBits = 28u;

// Workgroups list so many splats each, in the order of depth: few of the nearest, which have many
// times the tiles of others and would keep all waiting for their workgroup.
const uint kNearGroups = 256u;
const uint kNearSplats = 32u;

// Instances of such a workgroup that go through shared memory, from where they are written side by
// side: the splat's place among the workgroup's in the lowest bits, then the quarters, then
// the tile, where a frame has so few.
const uint kListStage = 1536u;
const uint kStagedMetShift = 8u, kStagedTileShift = 12u;
const uint kMostStagedTiles = 1u << (32u - kStagedTileShift);

// Where those of a workgroup begin.
STGS_FN uint list_begin(uint group) {
  uint near = group < kNearGroups ? group : kNearGroups;
  return near * kNearSplats + (group - near) * kGroup;
}

// The workgroups for so many splats.
STGS_FN uint list_groups(uint splats) {
  uint near = kNearGroups * kNearSplats;
  return splats <= near ? (splats + kNearSplats - 1u) / kNearSplats
                        : kNearGroups + (splats - near + kGroup - 1u) / kGroup;
}

// Sums stop here, above any count that can be drawn, instead of overflowing.
const uint kManyInstances = 1u << 30;

// Of `groups` workgroups of the sort, so many at a time are counted together too: about as many as
// there are such super groups then, which are no more.
STGS_FN uint super_group_of(uint groups) {
  uint size = 1u;
  while (size * size < groups) size *= 2u;
  return size;
}

// Successive primitives in a block of memory that are drawn at the same moment of their time.
struct Part {
  uint at;  // of its data, in units of 16 bytes
  uint primitives;
  uint first_chunk;  // of the frame's chunks
  uint first_group;  // of the dispatch over its block
  float ticks;       // the moment, and what its rounding has lost
  float ticks_rest;
};

struct ViewInput {
  PinholeCamera camera;
  Vec3 centre;  // of the camera, in the world
  Vec3 background;
  int width, height;  // pixels
  int tiles_x, tiles_y;
  uint first_tile;     // of the frame's, which are those of its views one after the other
  Vec2 fovea;          // its centre, pixels
  float fovea_radius;  // pixels
};

// What a frame is drawn from, beside its parts, which follow it. All views have all chunks: splat s
// is of view s / (chunks kGroup).
struct FrameInput {
  uint views;
  uint chunks;             // of a view
  uint instance_capacity;  // of all views
  uint tiles;              // of all views
  ViewInput view[kMostViews];
};

// Work whose extent the device finds: rows of four numbers, the groups of a dispatch along x, y and
// z, and how many items there are.
const uint kWorkSortDepth = 0u;   // items: visible splats
const uint kWorkCountTiles = 1u;  // workgroups for the visible splats
const uint kWorkListTiles = 2u;   // the same
const uint kWorkSortTiles = 3u;   // listed instances
const uint kWorkFindRanges = 4u;  // listed instances
// What the blend draws of a view where there are foveae: its patches with long lists, and with
// short ones.
const uint kLongPatches = 0u;
const uint kShortPatches = 1u;
const uint kPatchKinds = 2u;
const uint kWorkPatches = 5u;  // from here on, of each view each kind
const uint kWorks = 5u + kPatchKinds * kMostViews;

// Of workgroups that have ended, in those dispatches that the last one goes on alone.
const uint kEndedScanChunks = 0u;
const uint kEndedCountTiles = 1u;
const uint kEndedFindPatches = 2u;
const uint kEnded = 3u;

// What the blend writes of a picture.
const uint kPixelPlanes = 0u;  // floats, a plane a channel
const uint kPixelRgba8 = 1u;   // of an image of the caller's, side by side
const uint kPixelBgra8 = 2u;
const uint kPixelRgb10 = 3u;   // red lowest, alpha the upper two bits
const uint kPixelRgba16 = 4u;  // half floats
const uint kPixelRgba32 = 5u;

struct Push {
  uint work;                            // row that says how many items there are
  uint shift;                           // of the sort's digit, bits
  uint super_rows;                      // of the sort's pass, the first of its super groups
  uint tells_ranges;                    // of the last pass by tile: in place of keys, tile_ranges
  uint first_part, part_count, groups;  // of a dispatch over a block
  uint pixels;                          // kPixel...
  uint with_depth;                      // beside such pixels the plane of depth; 0: without
  uint view;                            // of the blend
  uint patches;                         // of it where there are foveae, k...Patches
};

STGS_LAYOUT_END

#endif
