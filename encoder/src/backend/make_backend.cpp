// SPDX-License-Identifier: Apache-2.0
#include "backend/backend.h"
#include "stgs/encoder/train.h"
#include "train/lockstep.h"

namespace stgs::encoder {

#if !STGS_HAS_CUDA
Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int) {
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

Result<std::unique_ptr<TrainBackend>> make_one(const std::string& name, const LogSink& log,
                                               int gpu) {
  if (name == "cpu") return make_cpu_backend();
  if (name != "cuda" && name != "auto") {
    return not_built("backend '{}' cannot train; use --backend cpu", name);
  }
  Result<std::unique_ptr<TrainBackend>> cuda = make_cuda_backend(gpu);
  if (cuda.ok()) return cuda;
  const StatusCode code = cuda.status().code();
  const std::string& reason = cuda.status().message();
  if (code != StatusCode::kNotBuilt && code != StatusCode::kUnsupported) return cuda;
  if (name == "cuda") return Status(code, reason + "; use --backend cpu");
  if (log) log(2, fmt::format("CUDA unavailable ({}); training on the CPU", reason));
  return make_cpu_backend();
}

}  // namespace

Result<std::unique_ptr<TrainBackend>> make_backend(const std::string& name, int gpu,
                                                   const LogSink& log, Ranks* ranks) {
  if (ranks == nullptr) return make_one(name, log, gpu);
  STGS_ASSIGN(std::unique_ptr<TrainBackend> backend, make_one(name, log, ranks->node_rank()));
  // Different CPU models are fine: every contribution is computed on one of them and then shared.
  const std::string kind = backend->name().rfind("cpu", 0) == 0 ? "cpu" : backend->name();
  STGS_TRY(Lockstep(ranks).check_same_text(kind, "backend or GPU model"));
  STGS_TRY(backend->join(*ranks));
  return backend;
}

}  // namespace stgs::encoder
