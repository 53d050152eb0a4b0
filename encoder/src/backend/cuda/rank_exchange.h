// SPDX-License-Identifier: Apache-2.0
// Exchanges the blocks of several ranks between their GPUs.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <memory>

#include "stgs/encoder/ranks.h"
#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

class RankExchange {
 public:
  virtual ~RankExchange() = default;
  // Enqueues an all-gather of `blocks` (size x bytes, on the device): block k receives rank k's own
  // block. `bytes` is equal on every rank.
  virtual Status all_gather(void* blocks, std::size_t bytes, cudaStream_t stream) = 0;
  // Returns the error of enqueued work, if any.
  virtual Status check() = 0;
  // Aborts enqueued work, which may be waiting for a failed rank. No other call may follow.
  virtual void abort() = 0;
};

// Creates an exchange over NCCL, with one GPU per rank: the current device. All ranks must call it
// together. kNotBuilt in a build without NCCL's header; kUnsupported if there is no NCCL or two
// ranks share a GPU.
Result<std::unique_ptr<RankExchange>> make_nccl_exchange(Ranks& ranks);

}  // namespace stgs::encoder::cuda
