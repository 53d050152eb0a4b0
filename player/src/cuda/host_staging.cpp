// SPDX-License-Identifier: Apache-2.0
#include "cuda/host_staging.h"

namespace stgs::player::cuda {
namespace {

// Returns at once if nothing was recorded.
Status wait_for(const Event& event) {
  return cuda_status(cudaEventSynchronize(event.get()), "uploading a segment");
}

}  // namespace

Status HostStaging::ensure(std::size_t bytes) {
  for (Half& half : halves_) {
    if (half.uploaded.get() == nullptr) {
      STGS_TRY(cuda_status(cudaEventCreateWithFlags(half.uploaded.fresh(), cudaEventDisableTiming),
                           "creating an event"));
    }
    if (half.memory.bytes() >= bytes) continue;
    STGS_TRY(wait_for(half.uploaded));
    STGS_TRY(half.memory.ensure(bytes));
  }
  return {};
}

Result<std::uint8_t*> HostStaging::next() {
  current_ = 1 - current_;
  STGS_TRY(wait_for(halves_[current_].uploaded));
  return halves_[current_].memory.data();
}

Status HostStaging::upload(void* to, std::size_t bytes, cudaStream_t stream) {
  const Half& half = halves_[current_];
  STGS_TRY(
      cuda_status(cudaMemcpyAsync(to, half.memory.data(), bytes, cudaMemcpyHostToDevice, stream),
                  "uploading a segment"));
  return cuda_status(cudaEventRecord(half.uploaded.get(), stream), "uploading a segment");
}

}  // namespace stgs::player::cuda
