// SPDX-License-Identifier: Apache-2.0
// Replaces nccl_exchange.cpp in builds without NCCL's header.
#include "backend/cuda/rank_exchange.h"

namespace stgs::encoder::cuda {

Result<std::unique_ptr<RankExchange>> make_nccl_exchange(Ranks&) {
  return not_built(
      "this build has no NCCL, which training with several processes on GPUs requires; rebuild "
      "with "
      "nccl.h available, or use --backend cpu");
}

}  // namespace stgs::encoder::cuda
