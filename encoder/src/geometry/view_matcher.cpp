// SPDX-License-Identifier: Apache-2.0
#include "geometry/view_matcher.h"

namespace stgs::encoder::geometry {

#if !STGS_HAS_CUDA
Result<std::unique_ptr<ViewMatcher>> make_cuda_matcher() {
  return not_built("this build has no CUDA support");
}
#endif

Result<std::unique_ptr<ViewMatcher>> make_matcher(const std::string& backend, const LogSink& log) {
  if (backend == "cpu") return make_cpu_matcher();
  if (backend != "cuda" && backend != "auto") {
    return not_built("backend '{}' has no stereo; use --backend cpu", backend);
  }
  Result<std::unique_ptr<ViewMatcher>> cuda = make_cuda_matcher();
  if (cuda.ok()) return cuda;
  const std::string& reason = cuda.status().message();
  if (backend == "cuda") return Status(cuda.status().code(), reason + "; use --backend cpu");
  if (log) log(2, fmt::format("CUDA unavailable ({}); stereo on the CPU", reason));
  return make_cpu_matcher();
}

}  // namespace stgs::encoder::geometry
