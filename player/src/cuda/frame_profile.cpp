// SPDX-License-Identifier: Apache-2.0
// FrameGraph: measures the steps of a frame and computes their lower bounds.
#include "cuda/frame_graph.h"

namespace stgs::player::cuda {
namespace {

// Bytes per buffer entry.
constexpr double kSupport = sizeof(float2), kCandidate = sizeof(Candidate), kKey = 4, kRange = 8;
// Bytes read per candidate, and per visible primitive.
constexpr double kMotion = 2 * sizeof(float4) + sizeof(float2);
constexpr double kCovariance = sizeof(float4) + sizeof(float2);
constexpr double kSplat = sizeof(ScreenSplat), kPixel = 5 * sizeof(float);

// Instructions of blend.cu: 5 per evaluated pixel, plus 4 that two pixels share; 8 per
// contribution, including the exponential.
constexpr double kEvaluation = 5 + 4.0 / 2, kContribution = 8;

// Returns the float lanes per multiprocessor.
int lanes_of(int major, int minor) {
  return major >= 9 || (major == 8 && minor >= 6) ? 128 : 64;
}

Status find_rates(RenderProfile& profile) {
  struct Attribute {
    cudaDeviceAttr attribute;
    int value;
  } clock{cudaDevAttrClockRate, 0}, processors{cudaDevAttrMultiProcessorCount, 0},
      memory_clock{cudaDevAttrMemoryClockRate, 0}, width{cudaDevAttrGlobalMemoryBusWidth, 0},
      major{cudaDevAttrComputeCapabilityMajor, 0}, minor{cudaDevAttrComputeCapabilityMinor, 0};
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "querying the current device"));
  for (Attribute* one : {&clock, &processors, &memory_clock, &width, &major, &minor}) {
    STGS_TRY(cuda_status(cudaDeviceGetAttribute(&one->value, one->attribute, device),
                         "querying device attributes"));
  }
  // Rates are in kHz; memory transfers twice per clock, and its width is in bits.
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
  const Status started = enqueue(grids, buffers, Measure::kSteps, cudaEventRecordDefault, stream);
  const cudaError_t ended = cudaStreamSynchronize(stream);
  STGS_TRY(started);
  STGS_TRY(cuda_status(ended, "rendering step by step"));

  const Counters& n = counters();
  const auto& frame = *reinterpret_cast<const FrameInput*>(staging_.data());
  const double stored = static_cast<double>(frame.chunks) * kChunk, active = n.active;
  const double splats = n.splats, listed = n.listed, tiles = current_.tiles;
  // A primitive that is visible in several views is read once.
  const double visible = splats / static_cast<double>(frame.view_count);
  double pixels = 0;
  for (const ImageLayout& layout : layouts_)
    pixels += static_cast<double>(layout.width) * layout.height;
  const double sh_bytes = static_cast<double>(sizeof(uint2)) * sh_planes(current_.sh_degree);
  const double tile_passes = buffers.workspace(current_.tiles).tile_passes;
  const struct {
    Step step;
    const char* name;
    double bytes, operations;
  } steps[] = {
      {kClear, "clear", static_cast<double>(buffers.cleared_bytes()), 0},
      {kSelect, "select", stored * kSupport + active * kCandidate, 0},
      {kProject, "project",
       active * (kCandidate + kMotion) + visible * (kCovariance + sh_bytes) +
           splats * (kSplat + 2 * kKey),
       0},
      // Each pass reads and writes keys and numbers, except the keys of the last pass.
      {kDepthSort, "depth_sort", splats * kKey * (4 * kDepthPasses - 1), 0},
      {kList, "list", splats * (kKey + kSplat) + listed * 2 * kKey, 0},
      {kTileSort, "tile_sort", listed * kKey * (4 * tile_passes + 1) + tiles * kRange, 0},
      {kBlend, "blend", listed * kKey + splats * kSplat + tiles * kRange + pixels * kPixel,
       static_cast<double>(n.evaluations) * kEvaluation +
           static_cast<double>(n.contributions) * kContribution},
  };
  for (const auto& step : steps) {
    RenderStep result{step.name, 0, step.bytes, step.operations};
    STGS_TRY(time_between(static_cast<Step>(step.step - 1), step.step, result.ms));
    profile.steps.push_back(std::move(result));
  }
  return profile;
}

}  // namespace stgs::player::cuda
