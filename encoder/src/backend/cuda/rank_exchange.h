// SPDX-License-Identifier: Apache-2.0
// How the GPUs of several ranks give each other their blocks.
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
  // Enqueues: block k of `blocks` (size x bytes, on the device) becomes what is rank k's own block
  // there. `bytes` is the same on every rank.
  virtual Status all_gather(void* blocks, std::size_t bytes, cudaStream_t stream) = 0;
  // What has gone wrong meanwhile with what is enqueued.
  virtual Status check() = 0;
  // Ends what is enqueued and may wait for a rank that has failed. Nothing comes after it.
  virtual void abort() = 0;
};

// By NCCL, a GPU a rank, the current one here; all ranks call it together. kNotBuilt in a build
// without NCCL's header, kUnsupported where there is no NCCL or two ranks have one GPU.
Result<std::unique_ptr<RankExchange>> make_nccl_exchange(Ranks& ranks);

}  // namespace stgs::encoder::cuda
