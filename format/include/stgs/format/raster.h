// SPDX-License-Identifier: Apache-2.0
// The CPU rasteriser: slice at time t, project, bin into tiles, blend. Its scalar target is the
// reference rendering (spec/representation.md, 6). The CPU backends of encoder and player use it.
#pragma once

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"

namespace stgs {

inline constexpr int kTileSize = 16;  // pixels, width and height

// One visible primitive at one time in one view; one cache line.
struct alignas(64) Splat {
  math::Vec2 mean;    // pixels
  math::Sym2 conic;   // 1/pixels^2
  float opacity;      // O_s (representation 3.4), after slicing
  math::Vec3 colour;  // sRGB-encoded, >= 0
  float depth;        // camera z
  math::Vec2 extent;  // half size of a box outside which alpha < kAlphaThreshold, pixels
  float reach;        // largest visible half squared distance: ln(O_s / kAlphaThreshold)
  std::uint32_t id;   // index of the primitive in its set, plus id_base
};

// Memory that a frame would need exceeds a limit.
class FrameTooLarge : public std::length_error {
 public:
  // `what`: the limit, or the allocation that exceeds SplatFrame::memory. `needed`: bytes that the
  // memory would hold at least; 0: another limit.
  FrameTooLarge(const std::string& what, std::uint64_t needed)
      : std::length_error(what), bytes(needed) {}
  std::uint64_t bytes;
};

// The splats of a view in ascending order of id, and the list of each tile, nearest first (ties:
// lower id first). Reuse an object for successive frames to avoid allocations.
struct SplatFrame {
  int width = 0, height = 0;  // pixels
  int tiles_x = 0, tiles_y = 0;
  std::vector<Splat> splats;              // ascending id
  std::vector<std::uint32_t> instances;   // indices into splats, tile after tile
  std::vector<std::uint32_t> tile_begin;  // tiles_x*tiles_y + 1 offsets into instances
  // Charged before memory that grows with the scene or the image is allocated; exceeding its limit
  // throws FrameTooLarge. Not owned. Null: not limited.
  WorkingMemory* memory = nullptr;

  // Working memory of slice() and bin(); private.
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

  // Sets the size; the values are then unspecified. Frees the old values before it allocates.
  void reshape(int w, int h, int c);
  // Returns the first pixel of a channel.
  float* plane(int c) { return data.data() + static_cast<std::size_t>(c) * width * height; }
  const float* plane(int c) const {
    return data.data() + static_cast<std::size_t>(c) * width * height;
  }
};

struct RasterOutput {
  Image colour;                     // 3 channels, background blended in
  Image alpha;                      // 1 channel, 1 - transmittance
  Image depth;                      // 1 channel, blend-weighted mean camera z; 0 where alpha is 0
  Image transmittance;              // 1 channel, remaining share of the background
  std::vector<std::uint32_t> last;  // per pixel: 1 + position of the last splat blended in its list
};

// The point of gaze. Blocks of 32 x 32 pixels beyond `radius` are rendered at half resolution: each
// 2 x 2 pixels share a colour, an alpha and a depth (math/fovea.h).
struct Fovea {
  math::Vec2 centre{0.0f, 0.0f};  // pixels; may lie outside the image
  float radius = 0;               // pixels, at least 0
};

struct RasterSettings {
  math::Vec3 background{0.0f, 0.0f, 0.0f};  // sRGB-encoded
  std::optional<Fovea> fovea;               // none: full resolution everywhere
  bool scalar = false;    // use the scalar reference target instead of the vector unit
  int max_sh_degree = 3;  // SH above this degree are ignored
  int kernel = 0;         // of the splats (representation 3.4)
};

// Starts a frame of the camera's size, without splats. This and the following functions throw
// FrameTooLarge if SplatFrame::memory does not allow an allocation.
void begin_frame(const math::PinholeCamera& camera, SplatFrame& frame);
// Appends the visible splats of the set at time t: motion, visibility, culling, projection, colour.
// t is in ticks and counts as set.time does; t - T is rounded to single precision once. The id of a
// splat is id_base plus its index in the set; ids must ascend from call to call.
void slice(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
           const RasterSettings& settings, std::uint32_t id_base, SplatFrame& frame);
// As above, for the candidate primitives only (ascending indices), such as those active in a
// segment.
void slice(const Gaussians4D& set, const std::vector<std::uint32_t>& candidates, double t,
           const math::PinholeCamera& camera, const RasterSettings& settings, std::uint32_t id_base,
           SplatFrame& frame);
// Fills the tile lists from frame.splats, using the exact ellipse-tile test. Throws FrameTooLarge
// if they would hold more than 2^26 entries. Uses up to 16 bytes per entry, of which up to 12 stay
// allocated.
void bin(SplatFrame& frame);
// Blends every tile, nearest splat first.
void blend(const SplatFrame& frame, const RasterSettings& settings, RasterOutput& output);

// Renders a complete set: begin_frame, slice, bin and blend.
void render(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
            const RasterSettings& settings, SplatFrame& frame, RasterOutput& output);

// Returns the name of the vector target in use, for reports ("AVX3", "AVX2", "SSE4", "scalar"...).
std::string vector_target();

}  // namespace stgs
