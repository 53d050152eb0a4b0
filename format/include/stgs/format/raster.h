// SPDX-License-Identifier: Apache-2.0
// The CPU rasteriser: slice at t, project, bin to tiles, blend. Its scalar target is the reference
// rendering of the representation (spec/representation.md, 6); the encoder's CPU backend and the
// player's CPU backend both draw with it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"

namespace stgs {

inline constexpr int kTileSize = 16;  // pixels, width and height

// One visible primitive at one moment in one view; a cache line.
struct alignas(64) Splat {
  math::Vec2 mean;    // pixels
  math::Sym2 conic;   // 1/pixels^2
  float opacity;      // O_t = O l(t), after slicing
  math::Vec3 colour;  // sRGB-encoded, >= 0
  float depth;        // camera z
  math::Vec2 extent;  // half size of a box outside which alpha < threshold, pixels
  float reach;        // largest half squared distance that is drawn: ln(O_t / threshold)
  std::uint32_t id;   // index of the primitive in its set
};

// Splats of a view in the order of their ids, and each tile's splats, nearest first (ties: lower id
// first). Reused from call to call to keep its memory.
struct SplatFrame {
  int width = 0, height = 0;  // pixels
  int tiles_x = 0, tiles_y = 0;
  std::vector<Splat> splats;              // ascending id
  std::vector<std::uint32_t> instances;   // indices into splats, tile after tile
  std::vector<std::uint32_t> tile_begin;  // tiles_x*tiles_y + 1 offsets into instances

  // Working memory of slice and bin; nothing to read here.
  struct Scratch {
    std::vector<std::vector<Splat>> slice_blocks;
    std::vector<std::uint32_t> order, order_next, keys, keys_next, counts;
    std::vector<std::vector<std::uint32_t>> bin_chunks;
  } scratch;
};

// Float image, planar: channel c of pixel (x,y) at data[(c*height + y)*width + x].
struct Image {
  int width = 0, height = 0, channels = 0;
  std::vector<float> data;

  void reshape(int w, int h, int c);
  float* plane(int c) { return data.data() + static_cast<std::size_t>(c) * width * height; }
  const float* plane(int c) const {
    return data.data() + static_cast<std::size_t>(c) * width * height;
  }
};

struct RasterOutput {
  Image colour;                     // 3 channels, background blended in
  Image alpha;                      // 1 channel, 1 - transmittance
  Image depth;                      // 1 channel, blend-weighted mean camera z; 0 where alpha is 0
  Image transmittance;              // 1 channel, share of the background that is left
  std::vector<std::uint32_t> last;  // per pixel: length of its tile's list up to the last one drawn
};

// Where the eye looks: what is farther from it is drawn at half resolution, in squares of 32
// pixels, where squares of 2 x 2 pixels share a colour, an alpha and a depth (math/fovea.h).
struct Fovea {
  math::Vec2 centre{0.0f, 0.0f};  // pixels; may lie outside the picture
  float radius = 0;               // pixels, at least 0
};

struct RasterSettings {
  math::Vec3 background{0.0f, 0.0f, 0.0f};
  std::optional<Fovea> fovea;  // none: full resolution everywhere
  bool scalar = false;         // the reference target instead of the machine's vector unit
  int max_sh_degree = 3;       // harmonics above it are left out
};

// Starts a frame of the camera's size with no splats.
void begin_frame(const math::PinholeCamera& camera, SplatFrame& frame);
// Appends what is visible of the set at moment t (ticks, counted as set.time): motion, visibility,
// culling, projection, colour. t - T is rounded to single precision once. Splat ids are id_base +
// index in the set; ids must ascend from call to call.
void slice(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
           const RasterSettings& settings, std::uint32_t id_base, SplatFrame& frame);
// The same for candidate primitives only (ascending), for instance those alive in a segment.
void slice(const Gaussians4D& set, const std::vector<std::uint32_t>& candidates, double t,
           const math::PinholeCamera& camera, const RasterSettings& settings, std::uint32_t id_base,
           SplatFrame& frame);
// Fills the tile lists from frame.splats with the exact ellipse-tile test. Throws std::length_error
// where they would hold more than 2^26 entries. Takes up to 16 bytes an entry, and keeps up to 12.
void bin(SplatFrame& frame);
// Blends every tile, nearest first.
void blend(const SplatFrame& frame, const RasterSettings& settings, RasterOutput& output);

// begin_frame + slice + bin + blend of one whole set.
void render(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
            const RasterSettings& settings, SplatFrame& frame, RasterOutput& output);

// Name of the vector target in use, for reports ("AVX3", "AVX2", "SSE4", "scalar"...).
std::string vector_target();

}  // namespace stgs
