// SPDX-License-Identifier: Apache-2.0
#include "backend/backend.h"
#include "stgs/encoder/train.h"

namespace stgs::encoder {

#if !STGS_HAS_CUDA
Result<std::unique_ptr<TrainBackend>> make_cuda_backend() {
  return not_built("backend 'cuda' cannot train in this build, which has no CUDA");
}
#endif

std::vector<std::string> train_backends() {
#if STGS_HAS_CUDA
  return {"cpu", "cuda"};
#else
  return {"cpu"};
#endif
}

Result<std::unique_ptr<TrainBackend>> make_backend(const std::string& name, const LogSink& log) {
  if (name == "cpu") return make_cpu_backend();
  if (name != "cuda" && name != "auto") {
    return not_built("backend '{}' cannot train in this build; use --backend cpu", name);
  }
  Result<std::unique_ptr<TrainBackend>> cuda = make_cuda_backend();
  if (cuda.ok()) return cuda;
  const StatusCode code = cuda.status().code();
  const std::string& reason = cuda.status().message();
  if (code != StatusCode::kNotBuilt && code != StatusCode::kUnsupported) return cuda;
  if (name == "cuda") return Status(code, reason + "; use --backend cpu");
  if (log) log(2, fmt::format("no CUDA: {}", reason));
  return make_cpu_backend();
}

}  // namespace stgs::encoder
