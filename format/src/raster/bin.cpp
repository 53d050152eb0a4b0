// SPDX-License-Identifier: Apache-2.0
// Tile lists. Splats are sorted by depth once and then distributed to the tiles that they touch, so
// that the list of each tile is in depth order.

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>

#include "raster/frame_memory.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_tiles.h"

namespace stgs {
namespace {

using raster::PixelBox;

// Returns the number of splats per chunk of the distribution: at most 32 chunks, because each has a
// counter per tile. Chunks are concatenated in order, whichever thread processed them.
std::size_t chunk_size(std::size_t splats) {
  return std::max<std::size_t>(1024, (splats + 31) / 32);
}

// Greatest number of entries of all tile lists; a view that needs more is broken or hostile. An
// entry takes 4 bytes in the list of its chunk, which is up to three times larger while it grows,
// and 4 bytes in the frame: at most 1 GiB, of which up to 12 bytes per entry stay allocated.
constexpr std::size_t kMaxInstances = std::size_t{1} << 26;
constexpr const char* kLists = "the tile lists";
// Entries after which a chunk updates the shared count.
constexpr std::size_t kReportInterval = std::size_t{1} << 18;

// Stable radix sort of 0..n-1 by depth; depths are positive, so their bits ascend with them.
void sort_by_depth(SplatFrame& frame) {
  constexpr int kBits = 11, kPasses = 3, kBuckets = 1 << kBits;
  const std::vector<Splat>& splats = frame.splats;
  SplatFrame::Scratch& s = frame.scratch;
  const std::size_t n = splats.size();
  for (auto* array : {&s.order, &s.order_next, &s.keys, &s.keys_next}) {
    raster::resize(*array, n, frame.memory, "the splats");
  }
  std::array<std::array<std::uint32_t, kBuckets>, kPasses> start{};
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t key = std::bit_cast<std::uint32_t>(splats[i].depth);
    s.keys[i] = key;
    s.order[i] = static_cast<std::uint32_t>(i);
    for (int pass = 0; pass < kPasses; ++pass)
      ++start[pass][(key >> (pass * kBits)) & (kBuckets - 1)];
  }
  for (int pass = 0; pass < kPasses; ++pass) {
    auto& at = start[pass];
    std::exclusive_scan(at.begin(), at.end(), at.begin(), 0u);
    for (std::size_t i = 0; i < n; ++i) {
      const std::uint32_t to = at[(s.keys[i] >> (pass * kBits)) & (kBuckets - 1)]++;
      s.keys_next[to] = s.keys[i];
      s.order_next[to] = s.order[i];
    }
    s.keys.swap(s.keys_next);
    s.order.swap(s.order_next);
  }
}

// Returns the minimum of d' conic d on the segment where one offset is `fixed` and the other is in
// [low, high], minus the rounding error of the blend. `along` is the conic's entry of the free
// offset.
float edge_minimum(float across, float cross, float along, float fixed, float low, float high) {
  const float free = std::clamp(-cross * fixed / along, low, high);
  const float a = across * fixed * fixed, b = along * free * free, c = 2.0f * cross * fixed * free;
  return a + b + c - 1e-6f * (a + b + std::abs(c));
}

// Returns whether the rectangle of the box's pixel centres intersects the splat's ellipse.
bool ellipse_meets(const Splat& s, const PixelBox& box) {
  const float x0 = static_cast<float>(box.x0) + 0.5f - s.mean.x;
  const float x1 = static_cast<float>(box.x1) - 0.5f - s.mean.x;
  const float y0 = static_cast<float>(box.y0) + 0.5f - s.mean.y;
  const float y1 = static_cast<float>(box.y1) - 0.5f - s.mean.y;
  const float q = 2.0f * s.reach + 1e-4f;
  const bool in_x = x0 <= 0.0f && x1 >= 0.0f, in_y = y0 <= 0.0f && y1 >= 0.0f;
  if (in_x && in_y) return true;
  // The minimum of a convex form is on an edge that faces its centre.
  if (!in_x && edge_minimum(s.conic.xx, s.conic.xy, s.conic.yy, x0 > 0.0f ? x0 : x1, y0, y1) <= q)
    return true;
  return !in_y &&
         edge_minimum(s.conic.yy, s.conic.xy, s.conic.xx, y0 > 0.0f ? y0 : y1, x0, x1) <= q;
}

// Returns the tiles of the splat's box: [x0,x1) x [y0,y1).
PixelBox tiles_of_box(const SplatFrame& frame, const Splat& s) {
  const PixelBox box = raster::covered_pixels(s, {0, 0, frame.width, frame.height});
  if (box.empty()) return {0, 0, 0, 0};
  return {box.x0 / kTileSize, box.y0 / kTileSize, (box.x1 - 1) / kTileSize + 1,
          (box.y1 - 1) / kTileSize + 1};
}

// Calls visit(tile) for each tile of the box that the splat touches, in ascending order.
template <typename Visit>
void for_each_tile(const SplatFrame& frame, const Splat& s, const PixelBox& box, Visit visit) {
  for (int ty = box.y0; ty < box.y1; ++ty) {
    for (int tx = box.x0; tx < box.x1; ++tx) {
      const int tile = ty * frame.tiles_x + tx;
      if (ellipse_meets(s, raster::tile_pixels(frame, tile))) visit(tile);
    }
  }
}

// Ensures that the number of the tiles of a splat, and its tiles, can be added to a list.
void make_capacity(std::vector<std::uint32_t>& list, const PixelBox& tiles, WorkingMemory* memory) {
  const auto most =
      static_cast<std::size_t>(tiles.x1 - tiles.x0) * static_cast<std::size_t>(tiles.y1 - tiles.y0);
  const std::size_t needed = list.size() + 1 + most;
  if (needed <= list.capacity()) return;
  raster::reserve(list, std::max(needed, 2 * list.capacity()), memory, kLists);
}

// Lists the tiles of the splats: each chunk lists, for each splat, the number of its tiles and the
// tiles; it also counts per tile. Throws FrameTooLarge beyond kMaxInstances, or if the memory of
// the frame does not allow the lists.
void list_tiles(SplatFrame& frame, std::size_t chunk, std::size_t chunks) {
  SplatFrame::Scratch& scratch = frame.scratch;
  const std::size_t tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  std::atomic<std::size_t> listed{0};
  parallel_for(std::size_t{0}, chunks, [&](std::size_t c) {
    auto& list = scratch.bin_chunks[c];
    std::uint32_t* counts = scratch.counts.data() + c * tiles;
    list.clear();
    const std::size_t end = std::min(frame.splats.size(), (c + 1) * chunk);
    std::size_t reported = 0;
    for (std::size_t k = c * chunk; k < end; ++k) {
      if (list.size() - reported > kReportInterval) {
        if (listed.fetch_add(list.size() - reported) > kMaxInstances) return;
        reported = list.size();
      }
      const Splat& splat = frame.splats[scratch.order[k]];
      const PixelBox box = tiles_of_box(frame, splat);
      make_capacity(list, box, frame.memory);
      const std::size_t head = list.size();
      list.push_back(0);
      for_each_tile(frame, splat, box, [&](int tile) {
        list.push_back(static_cast<std::uint32_t>(tile));
        ++counts[tile];
      });
      list[head] = static_cast<std::uint32_t>(list.size() - head - 1);
    }
    listed.fetch_add(list.size() - reported);
  });
  if (listed > kMaxInstances) {
    throw FrameTooLarge(
        "tile lists exceed 2^26 entries: the splats of this view are too large; render at a lower "
        "resolution",
        0);
  }
}

// Frees the lists of the chunks.
void free_lists(SplatFrame& frame) noexcept {
  for (auto& list : frame.scratch.bin_chunks) raster::free_values(list, frame.memory);
  frame.scratch.bin_chunks.clear();
}

// Turns counts into the first position of each chunk in the list of each tile. Returns the number
// of entries of all lists.
std::uint32_t place_lists(SplatFrame& frame, std::size_t chunks) {
  std::vector<std::uint32_t>& counts = frame.scratch.counts;
  const std::size_t tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  std::uint32_t total = 0;
  raster::resize(frame.tile_begin, tiles + 1, frame.memory, kLists);
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = total;
    for (std::size_t c = 0; c < chunks; ++c) {
      const std::uint32_t n = counts[c * tiles + tile];
      counts[c * tiles + tile] = total;
      total += n;
    }
  }
  frame.tile_begin[tiles] = total;
  return total;
}

}  // namespace

void bin(SplatFrame& frame) {
  SplatFrame::Scratch& scratch = frame.scratch;
  const std::size_t tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  const std::size_t chunk = chunk_size(frame.splats.size());
  const std::size_t chunks = (frame.splats.size() + chunk - 1) / chunk;
  sort_by_depth(frame);
  if (scratch.bin_chunks.size() < chunks) scratch.bin_chunks.resize(chunks);
  raster::resize(scratch.counts, chunks * tiles, frame.memory, kLists);
  std::fill(scratch.counts.begin(), scratch.counts.end(), 0u);
  try {
    list_tiles(frame, chunk, chunks);
    raster::resize(frame.instances, place_lists(frame, chunks), frame.memory, kLists);
  } catch (const FrameTooLarge&) {
    free_lists(frame);
    throw;
  }
  parallel_for(std::size_t{0}, chunks, [&](std::size_t c) {
    std::uint32_t* next = scratch.counts.data() + c * tiles;
    const std::uint32_t* list = scratch.bin_chunks[c].data();
    const std::size_t end = std::min(frame.splats.size(), (c + 1) * chunk);
    for (std::size_t k = c * chunk; k < end; ++k) {
      for (std::uint32_t n = *list++; n > 0; --n)
        frame.instances[next[*list++]++] = scratch.order[k];
    }
  });
}

}  // namespace stgs
