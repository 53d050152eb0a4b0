// SPDX-License-Identifier: Apache-2.0
// PatchMatch over views, on the CPU or on a GPU.
#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <string>

#include "geometry/frame_warp.h"
#include "geometry/hull_sweep.h"
#include "geometry/motion_finder.h"
#include "geometry/patch_match.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// A pass over the pixels of a view. All pointers are of host memory.
struct ViewPass {
  StereoProblem problem;
  PlaneMap map;              // in and out
  bool from_random = false;  // starts with random planes; otherwise with those of the map
  std::uint64_t seed = 0;
  int first = 0, iterations = 0;  // the iterations [first, first + iterations)
};

class ViewMatcher {
 public:
  virtual ~ViewMatcher() = default;
  virtual std::string name() const = 0;
  // Iterates over both colours of pixels. Thread-safe. kRuntime if a GPU fails.
  virtual Status run(const ViewPass& pass) = 0;
};

// Starts the GPU of a backend on another thread, which takes some tenths of a second. No effect
// without one: the functions below report it.
std::future<void> start_gpu(const std::string& backend, int gpu);

std::unique_ptr<ViewMatcher> make_cpu_matcher();
// kNotBuilt without CUDA, kUnsupported without a GPU.
Result<std::unique_ptr<ViewMatcher>> make_cuda_matcher(int gpu);
// `backend`: "cpu", "cuda" or "auto", which is CUDA if it can be used.
Result<std::unique_ptr<ViewMatcher>> make_matcher(const std::string& backend, int gpu,
                                                  const LogSink& log);
// The same for the frames of cameras, but returns null for the CPU.
Result<std::unique_ptr<FrameWarper>> make_frame_warper(const std::string& backend, int gpu,
                                                       const LogSink& log);
// The same for sweeps in the visual hull, but returns null for the CPU.
Result<std::unique_ptr<HullSweeper>> make_hull_sweeper(const std::string& backend, int gpu,
                                                       const LogSink& log);
// The same for motion detection.
Result<std::unique_ptr<MotionFinder>> make_motion_finder(const std::string& backend, int gpu,
                                                         const LogSink& log);

}  // namespace stgs::encoder::geometry
