// SPDX-License-Identifier: Apache-2.0
#include "cuda/host_staging.h"

namespace stgs::player::cuda {
namespace {

// At once where nothing was recorded.
Status wait_for(const Event& event) {
  return cuda_status(cudaEventSynchronize(event.get()), "sending a segment");
}

}  // namespace

Status HostStaging::ensure(std::size_t bytes) {
  for (Part& part : parts_) {
    if (part.sent.get() == nullptr) {
      STGS_TRY(cuda_status(cudaEventCreateWithFlags(part.sent.fresh(), cudaEventDisableTiming),
                           "creating an event"));
    }
    if (part.memory.bytes() >= bytes) continue;
    STGS_TRY(wait_for(part.sent));
    STGS_TRY(part.memory.ensure(bytes));
  }
  return {};
}

Result<std::uint8_t*> HostStaging::next() {
  filled_ = 1 - filled_;
  STGS_TRY(wait_for(parts_[filled_].sent));
  return parts_[filled_].memory.data();
}

Status HostStaging::upload(void* to, std::size_t bytes, cudaStream_t stream) {
  const Part& part = parts_[filled_];
  STGS_TRY(
      cuda_status(cudaMemcpyAsync(to, part.memory.data(), bytes, cudaMemcpyHostToDevice, stream),
                  "sending a segment"));
  return cuda_status(cudaEventRecord(part.sent.get(), stream), "sending a segment");
}

}  // namespace stgs::player::cuda
