// SPDX-License-Identifier: Apache-2.0
#include "geometry/view_matcher.h"

#include "geometry/velocity_matcher.h"
#include "geometry/view_sweeper.h"

namespace stgs::encoder::geometry {

#if !STGS_HAS_CUDA
namespace {
Status no_cuda() {
  return not_built("this build has no CUDA support");
}
}  // namespace

Result<std::unique_ptr<ViewMatcher>> make_cuda_matcher(int) {
  return no_cuda();
}
Result<std::unique_ptr<HullSweeper>> make_cuda_hull_sweeper(int) {
  return no_cuda();
}
Result<std::unique_ptr<FrameWarper>> make_cuda_frame_warper(int) {
  return no_cuda();
}
Result<std::unique_ptr<MotionFinder>> make_cuda_motion_finder(int) {
  return no_cuda();
}
Result<std::unique_ptr<VelocityMatcher>> make_cuda_velocity_matcher(int) {
  return no_cuda();
}
Result<std::unique_ptr<ViewSweeper>> make_cuda_view_sweeper(int) {
  return no_cuda();
}
#endif

namespace {

// Returns `cuda`, or null if CUDA cannot be used and need not be. `task`: for the log.
template <typename T>
Result<std::unique_ptr<T>> if_usable(Result<std::unique_ptr<T>> cuda, const std::string& backend,
                                     const char* task, const LogSink& log) {
  if (cuda.ok()) return cuda;
  const std::string& reason = cuda.status().message();
  if (backend == "cuda") return Status(cuda.status().code(), reason + "; use --backend cpu");
  if (log) log(2, fmt::format("CUDA unavailable ({}); {} on the CPU", reason, task));
  return std::unique_ptr<T>();
}

Status unknown_backend(const std::string& backend) {
  return not_built("backend '{}' cannot prepare captures; use --backend cpu", backend);
}

}  // namespace

std::future<void> start_gpu(const std::string& backend, int gpu) {
  if (backend == "cpu") return {};
  return std::async(std::launch::async, [gpu] { (void)make_cuda_hull_sweeper(gpu); });
}

Result<std::unique_ptr<ViewMatcher>> make_matcher(const std::string& backend, int gpu,
                                                  const LogSink& log) {
  if (backend == "cpu") return make_cpu_matcher();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  STGS_ASSIGN(auto cuda, if_usable(make_cuda_matcher(gpu), backend, "stereo", log));
  return cuda ? std::move(cuda) : make_cpu_matcher();
}

Result<std::unique_ptr<FrameWarper>> make_frame_warper(const std::string& backend, int gpu,
                                                       const LogSink& log) {
  if (backend == "cpu") return std::unique_ptr<FrameWarper>();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  return if_usable(make_cuda_frame_warper(gpu), backend, "frames", log);
}

Result<std::unique_ptr<HullSweeper>> make_hull_sweeper(const std::string& backend, int gpu,
                                                       const LogSink& log) {
  if (backend == "cpu") return std::unique_ptr<HullSweeper>();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  return if_usable(make_cuda_hull_sweeper(gpu), backend, "dynamic points", log);
}

Result<std::unique_ptr<VelocityMatcher>> make_velocity_matcher(const std::string& backend, int gpu,
                                                               const LogSink& log) {
  if (backend == "cpu") return std::unique_ptr<VelocityMatcher>();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  return if_usable(make_cuda_velocity_matcher(gpu), backend, "velocities", log);
}

Result<std::unique_ptr<ViewSweeper>> make_view_sweeper(const std::string& backend, int gpu,
                                                       const LogSink& log) {
  if (backend == "cpu") return std::unique_ptr<ViewSweeper>();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  return if_usable(make_cuda_view_sweeper(gpu), backend, "static depth", log);
}

Result<std::unique_ptr<MotionFinder>> make_motion_finder(const std::string& backend, int gpu,
                                                         const LogSink& log) {
  if (backend == "cpu") return std::unique_ptr<MotionFinder>();
  if (backend != "cuda" && backend != "auto") return unknown_backend(backend);
  return if_usable(make_cuda_motion_finder(gpu), backend, "motion", log);
}

}  // namespace stgs::encoder::geometry
