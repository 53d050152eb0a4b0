// SPDX-License-Identifier: Apache-2.0
// Depth maps of many views on a GPU, by plane sweeps. The reference on the CPU is
// init/depth_sweep.h.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "geometry/plane_sweep.h"
#include "geometry/sweep_cost.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// An image that a view is swept against.
struct SweptSource {
  int image = 0;
  SweepMapping mapping{};  // of the whole reference
};

struct ViewSweep {
  int reference = 0;                 // image
  std::vector<SweptSource> sources;  // 1 to kSweepSources
  double nearest = 0, farthest = 0;  // depth range, scene units
  int planes = 0;                    // 2 to kMaxSweepPlanes
  // Results, of the size of the reference: depth in scene units and cost in [0, 1].
  float *depth = nullptr, *cost = nullptr;
};

struct ViewSweeps {
  std::vector<SweepSource> images;  // pointers of host memory
  std::vector<ViewSweep> sweeps;
};

// Limit of the cost volumes of all sweeps of a problem, unless it has only one. An entry takes 3
// bytes of GPU memory.
inline constexpr std::size_t kMaxSweepVolume = std::size_t{1} << 26;

class ViewSweeper {
 public:
  virtual ~ViewSweeper() = default;
  virtual std::string name() const = 0;
  // Fills the results, for one problem at a time. Keeps its GPU memory for later problems.
  // Thread-safe. kRuntime if the GPU fails.
  virtual Status run(const ViewSweeps& problem) = 0;
};

// On GPU number `gpu` modulo the number of GPUs. kNotBuilt without CUDA, kUnsupported without one.
Result<std::unique_ptr<ViewSweeper>> make_cuda_view_sweeper(int gpu);
// `backend`: "cpu", "cuda" or "auto", which is CUDA if it can be used. Returns null for the CPU.
Result<std::unique_ptr<ViewSweeper>> make_view_sweeper(const std::string& backend, int gpu,
                                                       const LogSink& log);

}  // namespace stgs::encoder::geometry
