// SPDX-License-Identifier: Apache-2.0
#include "backend/backend.h"
#include "geometry/view_matcher.h"
#include "stgs/encoder/train.h"
#include "train/lockstep.h"

namespace stgs::encoder {

#if !STGS_HAS_CUDA
Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int) {
  return not_built("this build has no CUDA support");
}

Result<std::unique_ptr<geometry::ViewMatcher>> geometry::make_cuda_matcher() {
  return not_built("this build has no CUDA support");
}
#endif

std::vector<std::string> train_backends() {
#if STGS_HAS_CUDA
  return {"cpu", "cuda"};
#else
  return {"cpu"};
#endif
}

namespace {

// Makes the object of the backend `name`. `work` is what it does: auto takes the CPU for it if CUDA
// is unavailable.
template <typename T, typename MakeCuda, typename MakeCpu>
Result<std::unique_ptr<T>> make_one(const std::string& name, const LogSink& log, const char* work,
                                    const MakeCuda& make_cuda, const MakeCpu& make_cpu) {
  if (name == "cpu") return make_cpu();
  if (name != "cuda" && name != "auto") {
    return not_built("backend '{}' cannot do {}; use --backend cpu", name, work);
  }
  Result<std::unique_ptr<T>> cuda = make_cuda();
  if (cuda.ok()) return cuda;
  const StatusCode code = cuda.status().code();
  const std::string& reason = cuda.status().message();
  if (code != StatusCode::kNotBuilt && code != StatusCode::kUnsupported) return cuda;
  if (name == "cuda") return Status(code, reason + "; use --backend cpu");
  if (log) log(2, fmt::format("CUDA unavailable ({}); {} on the CPU", reason, work));
  return make_cpu();
}

Result<std::unique_ptr<TrainBackend>> make_trainer(const std::string& name, const LogSink& log,
                                                   int gpu) {
  return make_one<TrainBackend>(
      name, log, "training", [gpu] { return make_cuda_backend(gpu); }, make_cpu_backend);
}

}  // namespace

Result<std::unique_ptr<TrainBackend>> make_backend(const std::string& name, const LogSink& log,
                                                   Ranks* ranks) {
  if (ranks == nullptr) return make_trainer(name, log, 0);
  STGS_ASSIGN(std::unique_ptr<TrainBackend> backend, make_trainer(name, log, ranks->node_rank()));
  // Different CPU models are fine: every contribution is computed on one of them and then shared.
  const std::string kind = backend->name().rfind("cpu", 0) == 0 ? "cpu" : backend->name();
  STGS_TRY(Lockstep(ranks).check_same_text(kind, "backend or GPU model"));
  STGS_TRY(backend->join(*ranks));
  return backend;
}

Result<std::unique_ptr<geometry::ViewMatcher>> geometry::make_matcher(const std::string& backend,
                                                                      const LogSink& log) {
  return make_one<ViewMatcher>(backend, log, "stereo", make_cuda_matcher, make_cpu_matcher);
}

}  // namespace stgs::encoder
