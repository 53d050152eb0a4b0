// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_profile.h"

#include "packed_segment.h"

namespace stgs::player::vulkan {
namespace {

// Bytes per buffer entry, and bytes read per primitive (packed_segment.h): of each stored one, of
// each active one, and of each visible one.
constexpr double kKey = 4, kSplat = 48, kRange = 8, kPixel = kPlanes * sizeof(float);
constexpr double kSupport = 8, kMotion = 40, kCovariance = 24;

}  // namespace

std::vector<RenderStep> steps_of(const FrameWork& work, const Counts& counts, const StepTimes& ms) {
  const FrameInput& input = *work.input;
  const double stored = static_cast<double>(input.chunks) * kGroup, active = counts.active;
  const double splats = counts.visible, listed = counts.listed, tiles = input.tiles;
  const double chunks = static_cast<double>(input.views) * input.chunks;
  // A primitive that is visible in several views is read once.
  const double visible = splats / input.views;
  const double sh_bytes =
      static_cast<double>(packed_bytes_each(work.sh_degree)) - kSupport - kMotion - kCovariance;
  const std::uint32_t passes = tile_passes(input.tiles);
  const DigitRows rows(std::uint64_t{kGroup} * input.views * input.chunks, input.instance_capacity);
  const auto digits = static_cast<double>((rows.end(passes) - rows.groups) * DigitRows::kBytes);
  double pixels = 0;
  for (std::uint32_t v = 0; v < input.views; ++v) {
    pixels += static_cast<double>(input.view[v].width) * input.view[v].height;
  }
  const struct {
    FrameStep step;
    const char* name;
    double bytes;
  } steps[] = {
      {kClear, "clear",
       static_cast<double>(sizeof(input) + work.parts.size_bytes() + kCountBytes) + tiles * kRange +
           digits},
      {kProject, "project",
       stored * kSupport + active * kMotion + visible * (kCovariance + sh_bytes) + splats * kSplat},
      {kCompact, "compact", chunks * 2 * kKey + splats * 3 * kKey},
      // Each pass reads and writes keys and numbers, except the keys of the last pass.
      {kDepthSort, "depth_sort", splats * kKey * (4 * kDepthPasses - 1)},
      {kList, "list", splats * (kKey + kSplat) + listed * 2 * kKey},
      {kTileSort, "tile_sort", listed * kKey * (4 * passes - 1) + tiles * kRange},
      {kBlend, "blend", listed * kKey + splats * kSplat + tiles * kRange + pixels * kPixel},
  };
  std::vector<RenderStep> out;
  for (const auto& one : steps) out.push_back({one.name, ms[one.step], one.bytes, 0});
  return out;
}

}  // namespace stgs::player::vulkan
