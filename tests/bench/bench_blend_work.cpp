// SPDX-License-Identifier: Apache-2.0
// Prints the work that blending a view takes on any renderer, as JSON: visible splats, evaluations
// of a splat at a pixel, and contributions to pixels. Blocks of 8 x 8 pixels skip splats that miss
// them and end when all their pixels are opaque. For tile lists of 16, 32 and 64 pixels: their
// length, and the batches of 32 entries that the blocks read.
//
// usage: bench_blend_work SCENE.stgs WIDTHxHEIGHT SECONDS CAMERA.json...
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <numeric>

#include "camera_file.h"
#include "options.h"
#include "session.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_tiles.h"
#include "stgs/player/timeline.h"

namespace stgs::tools {
namespace {

constexpr int kBlock = 8, kBatch = 32;
constexpr std::array<int, 3> kSides = {16, 32, 64};
constexpr int kMaxSide = 64;

struct Work {
  double hits = 0, evaluations = 0, contributions = 0;  // hits: pairs of splat and block
  std::array<double, kSides.size()> entries{}, longest{}, batches{};

  void add(const Work& other) {
    hits += other.hits;
    evaluations += other.evaluations;
    contributions += other.contributions;
    for (std::size_t k = 0; k < kSides.size(); ++k) {
      entries[k] += other.entries[k];
      longest[k] = std::max(longest[k], other.longest[k]);
      batches[k] += other.batches[k];
    }
  }
};

using List = std::vector<std::uint32_t>;  // splats, nearest first

// Blends a block; returns the number of splats read until all its pixels are opaque.
std::size_t blend_block(const SplatFrame& frame, const List& list, const raster::PixelBox& block,
                        Work& work) {
  std::array<float, kBlock * kBlock> transmittance{};  // 0: opaque
  const int width = block.x1 - block.x0;
  int open = width * (block.y1 - block.y0);
  std::fill_n(transmittance.begin(), open, 1.0f);
  for (std::size_t k = 0; k < list.size(); ++k) {
    const Splat& s = frame.splats[list[k]];
    const raster::PixelBox box = raster::covered_pixels(s, block);
    bool hit = false;
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        const float power = math::splat_power(s.conic, static_cast<float>(x) + 0.5f - s.mean.x,
                                              static_cast<float>(y) + 0.5f - s.mean.y);
        const float alpha = math::splat_alpha(s.opacity, power);
        if (alpha == 0.0f) continue;
        hit = true;
        float& t = transmittance[static_cast<std::size_t>((y - block.y0) * width + x - block.x0)];
        if (t == 0.0f) continue;
        t *= 1.0f - alpha;
        if (t >= math::kTransmittanceMin) {
          ++work.contributions;
        } else {
          t = 0.0f;
          --open;
        }
      }
    }
    if (hit) {
      ++work.hits;
      work.evaluations += kBlock * kBlock;
    }
    if (open == 0) return k + 1;
  }
  return list.size();
}

// Merges the lists of a square of tiles.
List merge_lists(const SplatFrame& frame, const std::vector<std::uint32_t>& rank, int x0, int y0,
                 int tiles) {
  List list;
  for (int y = y0; y < std::min(y0 + tiles, frame.tiles_y); ++y) {
    for (int x = x0; x < std::min(x0 + tiles, frame.tiles_x); ++x) {
      const std::uint32_t* const begin = frame.tile_begin.data() + y * frame.tiles_x + x;
      list.insert(list.end(), frame.instances.begin() + begin[0],
                  frame.instances.begin() + begin[1]);
    }
  }
  std::sort(list.begin(), list.end(),
            [&rank](std::uint32_t a, std::uint32_t b) { return rank[a] < rank[b]; });
  list.erase(std::unique(list.begin(), list.end()), list.end());
  return list;
}

// Counts all blocks of a square of the k-th side; pixels are counted for the first side only.
void count_square(const SplatFrame& frame, const std::vector<std::uint32_t>& rank, std::size_t k,
                  int x0, int y0, Work& work) {
  const int side = kSides[k];
  const List list = merge_lists(frame, rank, x0 / kTileSize, y0 / kTileSize, side / kTileSize);
  work.entries[k] += static_cast<double>(list.size());
  work.longest[k] = std::max(work.longest[k], static_cast<double>(list.size()));
  Work discarded;
  for (int y = y0; y < std::min(y0 + side, frame.height); y += kBlock) {
    for (int x = x0; x < std::min(x0 + side, frame.width); x += kBlock) {
      const raster::PixelBox block{x, y, std::min(x + kBlock, frame.width),
                                   std::min(y + kBlock, frame.height)};
      const std::size_t taken = blend_block(frame, list, block, k == 0 ? work : discarded);
      work.batches[k] += static_cast<double>((taken + kBatch - 1) / kBatch);
    }
  }
}

Work count(const SplatFrame& frame) {
  std::vector<std::uint32_t> order(frame.splats.size()), rank(order.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&frame](std::uint32_t a, std::uint32_t b) {
    return frame.splats[a].depth < frame.splats[b].depth;
  });
  for (std::uint32_t i = 0; i < order.size(); ++i) rank[order[i]] = i;
  const int columns = (frame.width + kMaxSide - 1) / kMaxSide;
  const int rows = (frame.height + kMaxSide - 1) / kMaxSide;
  std::vector<Work> parts(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
    const int x0 = static_cast<int>(i) % columns * kMaxSide;
    const int y0 = static_cast<int>(i) / columns * kMaxSide;
    for (std::size_t k = 0; k < kSides.size(); ++k) {
      for (int y = y0; y < std::min(y0 + kMaxSide, frame.height); y += kSides[k]) {
        for (int x = x0; x < std::min(x0 + kMaxSide, frame.width); x += kSides[k]) {
          count_square(frame, rank, k, x, y, parts[i]);
        }
      }
    }
  });
  Work all;
  for (const Work& part : parts) all.add(part);
  return all;
}

// Means over the cameras.
Result<Json> measure(const std::string& path, Size size, double seconds,
                     const std::vector<std::string>& cameras) {
  STGS_ASSIGN(auto timeline, player::Timeline::open(path));
  STGS_ASSIGN(const auto active, timeline->at(seconds));
  Work work;
  double splats = 0;
  for (const std::string& file : cameras) {
    STGS_ASSIGN(const encoder::Camera camera, read_camera(file));
    const auto pinhole = resized(camera, size).pinhole(timeline->metadata().near_plane);
    SplatFrame frame;
    begin_frame(pinhole, frame);
    for (const auto& part : active.segments) {
      slice(*part.set, *part.candidates, part.ticks, pinhole, {}, part.id_base, frame);
    }
    bin(frame);
    splats += static_cast<double>(frame.splats.size());
    work.add(count(frame));
  }
  const auto n = static_cast<double>(cameras.size());
  Json lists = Json::array();
  for (std::size_t k = 0; k < kSides.size(); ++k) {
    lists.push_back({{"side", kSides[k]},
                     {"entries", work.entries[k] / n},
                     {"longest", work.longest[k]},
                     {"batches", work.batches[k] / n}});
  }
  return Json{{"width", size.width},
              {"height", size.height},
              {"cameras", cameras.size()},
              {"splats", splats / n},
              {"hits", work.hits / n},
              {"evaluations", work.evaluations / n},
              {"contributions", work.contributions / n},
              {"lists", lists}};
}

}  // namespace
}  // namespace stgs::tools

int main(int argc, char** argv) {
  using namespace stgs::tools;
  if (argc < 5) {
    std::fprintf(stderr, "usage: %s SCENE.stgs WIDTHxHEIGHT SECONDS CAMERA.json...\n", argv[0]);
    return 1;
  }
  const auto run = [&]() -> stgs::Result<Json> {
    STGS_ASSIGN(const Size size, parse_size(argv[2]));
    return measure(argv[1], size, std::atof(argv[3]), {argv + 4, argv + argc});
  };
  const stgs::Result<Json> result = run();
  if (!result.ok()) {
    std::fprintf(stderr, "%s: %s\n", argv[0], result.status().message().c_str());
    return 1;
  }
  std::puts(json_text(*result, 2).c_str());
}
