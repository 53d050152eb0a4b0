// SPDX-License-Identifier: Apache-2.0
// The importances of primitives (train/importance.h) on a GPU.
#include <algorithm>

#include "backend/cuda/cuda_backend.h"

namespace stgs::encoder::cuda {

Result<std::size_t> CudaBackend::add_importances(std::span<const ImportanceView> views,
                                                 unsigned long long* sums) {
  STGS_TRY(view_counters_.ensure(kImportanceBatch));
  const Status enqueued = enqueue_importances(views, sums);
  STGS_TRY(stream_.wait());
  const std::span<const Counters> counters(view_counters_.data(), views.size());
  const auto overflowed = std::find_if(counters.begin(), counters.end(),
                                       [](const Counters& view) { return view.overflow != 0; });
  // Before errors are returned, because later steps would have no effect.
  if (!enqueued.ok() || overflowed != counters.end()) STGS_TRY(pipeline_.clear_overflow(stream_));
  STGS_TRY(enqueued);
  for (const Counters& view : counters) {
    STGS_TRY(check_instances(view.instances));
    recent_instances_ = std::max<std::size_t>(recent_instances_, view.instances);
  }
  return static_cast<std::size_t>(overflowed - counters.begin());
}

Status CudaBackend::enqueue_importances(std::span<const ImportanceView> views,
                                        unsigned long long* sums) {
  for (std::size_t v = 0; v < views.size(); ++v) {
    StepInput input;
    input.camera = views[v].camera;
    input.ticks = views[v].ticks;
    input.kernel = views[v].kernel;
    STGS_ASSIGN(const std::size_t capacity, reserve_step(input));
    STGS_TRY(pipeline_.enqueue_importance(device_, input, capacity, sums, view_counters_.data() + v,
                                          stream_));
  }
  return {};
}

Result<std::optional<std::vector<float>>> CudaBackend::importance(
    std::span<const ImportanceView> views, const std::function<bool(double)>& should_continue) {
  using Importance = std::optional<std::vector<float>>;
  STGS_TRY(collect(true));
  const std::size_t n = size();
  DeviceArray<unsigned long long> sums;
  if (!sums.ensure(n).ok()) {
    STGS_TRY(image_cache_.release_memory());
    STGS_TRY(sums.ensure(n));
  }
  STGS_TRY(cuda_status(cudaMemsetAsync(sums.data(), 0, n * sizeof(unsigned long long), stream_),
                       "clearing the importances"));
  for (std::size_t v = 0; v < views.size();) {
    const std::size_t count = std::min(kImportanceBatch, views.size() - v);
    for (std::size_t k = v; k < v + count; ++k) {
      if (!should_continue(static_cast<double>(k) / static_cast<double>(views.size())))
        return Importance();
    }
    STGS_ASSIGN(const std::size_t added, add_importances(views.subspan(v, count), sums.data()));
    v += added;
  }
  std::vector<unsigned long long> found(n);
  STGS_TRY(cuda_status(cudaMemcpyAsync(found.data(), sums.data(), n * sizeof(found[0]),
                                       cudaMemcpyDeviceToHost, stream_),
                       "copying the importances"));
  STGS_TRY(stream_.wait());
  Importance out(n);
  std::transform(found.begin(), found.end(), out->begin(), [](unsigned long long sum) {
    return static_cast<float>(static_cast<double>(sum) / kImportanceOne);
  });
  return out;
}

}  // namespace stgs::encoder::cuda
