// SPDX-License-Identifier: Apache-2.0
// In the place of nccl_exchange.cpp where NCCL's header is not there.
#include "backend/cuda/rank_exchange.h"

namespace stgs::encoder::cuda {

Result<std::unique_ptr<RankExchange>> make_nccl_exchange(Ranks&) {
  return not_built(
      "this build has no NCCL, which several processes need to train on GPUs: build again where "
      "nccl.h is found, or use --backend cpu");
}

}  // namespace stgs::encoder::cuda
