// SPDX-License-Identifier: Apache-2.0
// What the steps of a frame take, beside what they cannot do without.
#include "cuda/frame_graph.h"

namespace stgs::player::cuda {
namespace {

// Bytes of an entry of a buffer.
constexpr double kSupport = sizeof(float2), kCandidate = sizeof(Candidate), kKey = 4, kRange = 8;
// What each candidate is read of, and what it is read of where it is seen.
constexpr double kMoment = 2 * sizeof(float4) + sizeof(float2);
constexpr double kCovariance = sizeof(float4) + sizeof(float2);
constexpr double kSplat = sizeof(ScreenSplat), kPixel = 5 * sizeof(float);

// Instructions that blend.cu's arithmetic takes: 5 a pixel at which a splat is evaluated and 4 that
// two pixels share; 8 where it contributes, the exponential among them.
constexpr double kEvaluation = 5 + 4.0 / 2, kContribution = 8;

// Lanes for floats of a multiprocessor.
int lanes_of(int major, int minor) {
  return major >= 9 || (major == 8 && minor >= 6) ? 128 : 64;
}

Status find_rates(RenderProfile& profile) {
  struct Wanted {
    cudaDeviceAttr attribute;
    int value;
  } clock{cudaDevAttrClockRate, 0}, processors{cudaDevAttrMultiProcessorCount, 0},
      memory_clock{cudaDevAttrMemoryClockRate, 0}, width{cudaDevAttrGlobalMemoryBusWidth, 0},
      major{cudaDevAttrComputeCapabilityMajor, 0}, minor{cudaDevAttrComputeCapabilityMinor, 0};
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "asking for the device"));
  for (Wanted* one : {&clock, &processors, &memory_clock, &width, &major, &minor}) {
    STGS_TRY(cuda_status(cudaDeviceGetAttribute(&one->value, one->attribute, device),
                         "asking for the device's rates"));
  }
  // kHz; memory sends twice a clock, and its width is in bits.
  profile.bytes_per_second = 2e3 * memory_clock.value * width.value / 8;
  profile.operations_per_second =
      1e3 * clock.value * processors.value * lanes_of(major.value, minor.value);
  return {};
}

}  // namespace

Result<RenderProfile> FrameGraph::profile(const Grids& grids, const FrameBuffers& buffers,
                                          cudaStream_t stream) {
  RenderProfile profile;
  STGS_TRY(find_rates(profile));
  const Status started = enqueue(grids, buffers, Telling::kSteps, cudaEventRecordDefault, stream);
  const cudaError_t ended = cudaStreamSynchronize(stream);
  STGS_TRY(started);
  STGS_TRY(cuda_status(ended, "drawing step by step"));

  const Counters& n = counted();
  const auto& frame = *reinterpret_cast<const FrameInput*>(staged_.data());
  const double stored = static_cast<double>(frame.chunks) * kChunk, alive = n.alive;
  const double splats = n.splats, listed = n.listed, tiles = now_.tiles;
  // A primitive that several views see is read once.
  const double seen = splats / static_cast<double>(frame.view_count);
  double pixels = 0;
  for (const Place& place : places_) pixels += static_cast<double>(place.width) * place.height;
  const double harmonics = static_cast<double>(sizeof(uint2)) * sh_planes(now_.sh_degree);
  const double tile_passes = buffers.workspace(now_.tiles).tile_passes;
  const struct {
    Step step;
    const char* name;
    double bytes, operations;
  } steps[] = {
      {kClear, "clear", static_cast<double>(buffers.cleared_bytes()), 0},
      {kSelect, "select", stored * kSupport + alive * kCandidate, 0},
      {kProject, "project",
       alive * (kCandidate + kMoment) + seen * (kCovariance + harmonics) +
           splats * (kSplat + 2 * kKey),
       0},
      // Keys and numbers are read and written by each pass, but for the last one's keys.
      {kDepthSort, "depth_sort", splats * kKey * (4 * kDepthPasses - 1), 0},
      {kList, "list", splats * (kKey + kSplat) + listed * 2 * kKey, 0},
      {kTileSort, "tile_sort", listed * kKey * (4 * tile_passes + 1) + tiles * kRange, 0},
      {kBlend, "blend", listed * kKey + splats * kSplat + tiles * kRange + pixels * kPixel,
       static_cast<double>(n.evaluations) * kEvaluation +
           static_cast<double>(n.contributions) * kContribution},
  };
  for (const auto& step : steps) {
    RenderStep told{step.name, 0, step.bytes, step.operations};
    STGS_TRY(time_between(static_cast<Step>(step.step - 1), step.step, told.ms));
    profile.steps.push_back(std::move(told));
  }
  return profile;
}

}  // namespace stgs::player::cuda
