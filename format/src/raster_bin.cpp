// SPDX-License-Identifier: Apache-2.0
// Tile lists: splats are put in depth order once, then dealt to the tiles that they touch, so that
// each tile's list comes out in depth order.

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "stgs/format/parallel.h"
#include "stgs/format/raster_tiles.h"

namespace stgs {
namespace {

using raster::PixelBox;

// Splats a chunk of the dealing, so that there are at most 32 chunks (each counts every tile).
// Chunks are joined in order, whichever thread dealt them.
std::size_t chunk_size(std::size_t splats) {
  return std::max<std::size_t>(1024, (splats + 31) / 32);
}

// Entries of all tile lists, at most; a view that needs more is broken or hostile. An entry takes 4
// bytes in its chunk's list, which has up to three times its size while it grows, and 4 in the
// frame's, which are kept for the next call: together at most 1 GiB, and 12 bytes an entry after.
constexpr std::size_t kMaxInstances = std::size_t{1} << 26;
// A chunk tells the others how much it has listed each time it has this much more.
constexpr std::size_t kTell = std::size_t{1} << 18;

// Stable radix sort of 0..n-1 by depth; depths are positive, so their bits ascend with them.
void sort_by_depth(const std::vector<Splat>& splats, SplatFrame::Scratch& s) {
  constexpr int kBits = 11, kPasses = 3, kBuckets = 1 << kBits;
  const std::size_t n = splats.size();
  s.order.resize(n);
  s.order_next.resize(n);
  s.keys.resize(n);
  s.keys_next.resize(n);
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

// Least d' conic d on the segment where one offset is `fixed` and the other in [low, high], less
// the rounding error that the blend may make there. `along` is the conic's entry of the free
// offset.
float edge_minimum(float across, float cross, float along, float fixed, float low, float high) {
  const float free = std::clamp(-cross * fixed / along, low, high);
  const float a = across * fixed * fixed, b = along * free * free, c = 2.0f * cross * fixed * free;
  return a + b + c - 1e-6f * (a + b + std::abs(c));
}

// Whether any point of the rectangle of the box's pixel centres lies in the splat's ellipse.
bool ellipse_meets(const Splat& s, const PixelBox& box) {
  const float x0 = static_cast<float>(box.x0) + 0.5f - s.mean.x;
  const float x1 = static_cast<float>(box.x1) - 0.5f - s.mean.x;
  const float y0 = static_cast<float>(box.y0) + 0.5f - s.mean.y;
  const float y1 = static_cast<float>(box.y1) - 0.5f - s.mean.y;
  const float q = 2.0f * s.reach + 1e-4f;
  const bool in_x = x0 <= 0.0f && x1 >= 0.0f, in_y = y0 <= 0.0f && y1 >= 0.0f;
  if (in_x && in_y) return true;
  // A convex form is least on an edge that faces its centre.
  if (!in_x && edge_minimum(s.conic.xx, s.conic.xy, s.conic.yy, x0 > 0.0f ? x0 : x1, y0, y1) <= q)
    return true;
  return !in_y &&
         edge_minimum(s.conic.yy, s.conic.xy, s.conic.xx, y0 > 0.0f ? y0 : y1, x0, x1) <= q;
}

// Calls visit(tile) for each tile that the splat touches, in ascending order.
template <typename Visit>
void for_each_tile(const SplatFrame& frame, const Splat& s, Visit visit) {
  const PixelBox box = raster::covered_pixels(s, {0, 0, frame.width, frame.height});
  if (box.empty()) return;
  const int tx0 = box.x0 / kTileSize, tx1 = (box.x1 - 1) / kTileSize;
  const int ty0 = box.y0 / kTileSize, ty1 = (box.y1 - 1) / kTileSize;
  for (int ty = ty0; ty <= ty1; ++ty) {
    for (int tx = tx0; tx <= tx1; ++tx) {
      const int tile = ty * frame.tiles_x + tx;
      if (ellipse_meets(s, raster::tile_pixels(frame, tile))) visit(tile);
    }
  }
}

}  // namespace

void bin(SplatFrame& frame) {
  SplatFrame::Scratch& scratch = frame.scratch;
  const std::size_t tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  const std::size_t chunk = chunk_size(frame.splats.size());
  const std::size_t chunks = (frame.splats.size() + chunk - 1) / chunk;
  sort_by_depth(frame.splats, scratch);
  if (scratch.bin_chunks.size() < chunks) scratch.bin_chunks.resize(chunks);
  scratch.counts.assign(chunks * tiles, 0);

  // Each chunk lists for each splat the number of its tiles, then the tiles, and counts by tile.
  std::atomic<std::size_t> listed{0};
  parallel_for(std::size_t{0}, chunks, [&](std::size_t c) {
    auto& list = scratch.bin_chunks[c];
    std::uint32_t* counts = scratch.counts.data() + c * tiles;
    list.clear();
    const std::size_t end = std::min(frame.splats.size(), (c + 1) * chunk);
    std::size_t told = 0;
    for (std::size_t k = c * chunk; k < end; ++k) {
      if (list.size() - told > kTell) {
        if (listed.fetch_add(list.size() - told) > kMaxInstances) return;
        told = list.size();
      }
      const std::size_t head = list.size();
      list.push_back(0);
      for_each_tile(frame, frame.splats[scratch.order[k]], [&](int tile) {
        list.push_back(static_cast<std::uint32_t>(tile));
        ++counts[tile];
      });
      list[head] = static_cast<std::uint32_t>(list.size() - head - 1);
    }
    listed.fetch_add(list.size() - told);
  });
  if (listed > kMaxInstances) {
    scratch.bin_chunks.clear();
    throw std::length_error(
        "the view's splats touch more tiles than a frame can list (2^26); draw a "
        "smaller picture");
  }

  // Counts become each chunk's first place in each tile's list.
  std::uint32_t total = 0;
  frame.tile_begin.resize(tiles + 1);
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = total;
    for (std::size_t c = 0; c < chunks; ++c) {
      const std::uint32_t n = scratch.counts[c * tiles + tile];
      scratch.counts[c * tiles + tile] = total;
      total += n;
    }
  }
  frame.tile_begin[tiles] = total;
  // Not grown by doubling, and not beside the old ones.
  if (frame.instances.capacity() < total) std::vector<std::uint32_t>().swap(frame.instances);
  frame.instances.resize(total);
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
