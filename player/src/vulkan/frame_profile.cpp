// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_profile.h"

#include <algorithm>
#include <array>

#include "vulkan/packed_segment.h"
#include "vulkan/times.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint64_t kCopied = std::uint64_t{128} << 20;  // bytes; more than caches hold

// Bytes of an entry of a buffer, and of what a primitive is read of: each that is stored, each that
// is alive, and what is seen (packed_segment.h).
constexpr double kKey = 4, kSplat = 48, kRange = 8, kPixel = kPlanes * sizeof(float);
constexpr double kSupport = 8, kMoment = 40, kCovariance = 24;

}  // namespace

Result<double> copied_bytes_per_second(Device& device) {
  Buffer from, to;
  STGS_TRY(from.create(device, kCopied, Place::kDevice));
  STGS_TRY(to.create(device, kCopied, Place::kDevice));
  Times times;
  STGS_TRY(times.create(device, 3));
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device.begin(&commands));
  device.vk.vkCmdResetQueryPool(commands, times.pool(), 0, 3);
  const VkBufferCopy all{0, 0, kCopied};
  // The second counts: the first touches the memory for the first time.
  for (std::uint32_t k = 0; k < 3; ++k) {
    device.vk.vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, times.pool(), k);
    barrier(device, commands);
    if (k < 2) device.vk.vkCmdCopyBuffer(commands, from.handle(), to.handle(), 1, &all);
  }
  STGS_TRY(device.finish(commands));
  std::array<double, 2> ms{};
  STGS_TRY(times.between(ms));
  return 2e3 * static_cast<double>(kCopied) / std::max(ms[1], 1e-6);
}

std::vector<RenderStep> steps_of(const FrameWork& work, const Counts& counts, const StepTimes& ms) {
  const FrameInput& input = *work.input;
  const double stored = static_cast<double>(input.chunks) * kGroup, alive = counts.alive;
  const double splats = counts.visible, listed = counts.listed, tiles = input.tiles;
  const double chunks = static_cast<double>(input.views) * input.chunks;
  // A primitive that several views see is read once.
  const double seen = splats / input.views;
  const double harmonics =
      static_cast<double>(packed_bytes_each(work.sh_degree)) - kSupport - kMoment - kCovariance;
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
       stored * kSupport + alive * kMoment + seen * (kCovariance + harmonics) + splats * kSplat},
      {kCompact, "compact", chunks * 2 * kKey + splats * 3 * kKey},
      // Keys and numbers are read and written by each pass, but for the last one's keys.
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
