// SPDX-License-Identifier: Apache-2.0
// Launches of densification's kernels, and what they count.
#pragma once

#include "backend/cuda/kernels.h"
#include "train/densify_rules.h"

namespace stgs::encoder::cuda {

// Filled by the kernels below, on the device.
struct DensifyTotals {
  std::uint32_t kept, non_finite;
  std::uint32_t candidates;  // that want to grow
  std::uint32_t split;       // of those chosen
};

struct RandomKey {
  std::uint64_t seed, iteration;
};

// flags[i]: 1 where primitive i is worth keeping; counts kept and broken.
void launch_mark_alive(const Primitives& p, const DensifyRules& rules, std::uint32_t* flags,
                       DensifyTotals* totals, cudaStream_t stream);
// Lists the primitives whose flag is `wanted`: list[places[i]] = i.
void launch_list(std::uint32_t n, const std::uint32_t* flags, std::uint32_t wanted,
                 const std::uint32_t* places, std::uint32_t* list, cudaStream_t stream);
// flags[i] = 1 - flags[i].
void launch_invert(std::uint32_t n, std::uint32_t* flags, cudaStream_t stream);
// to[k] = from[list[k]], `words` at a time.
void launch_gather(const std::uint32_t* from, std::uint32_t* to, const std::uint32_t* list,
                   std::size_t n, int words, cudaStream_t stream);

// Keys that ascend as the urgency of growth falls, ~0 for those that stay; counts candidates.
void launch_urgency(const Primitives& p, const DensifyRules& rules, std::uint32_t* keys,
                    DensifyTotals* totals, cudaStream_t stream);
// flags and draws (random numbers taken) of the first `count` of order, 0 for all others.
void launch_choose(const Primitives& p, const DensifyRules& rules, const std::uint32_t* order,
                   std::uint32_t count, std::uint32_t* flags, std::uint32_t* draws,
                   DensifyTotals* totals, cudaStream_t stream);
// Clones or splits those flagged to the places n + places[i].
void launch_grow(const Primitives& p, const DensifyRules& rules, const std::uint32_t* flags,
                 const std::uint32_t* places, const std::uint32_t* draws_before, RandomKey key,
                 cudaStream_t stream);

// Keys that ascend as the score falls, ~0 for those not alive. *unit_error, the error that counts
// as 1, is bits of a float.
void launch_scores(const Primitives& p, const ScoreRules& rules, bool modulated,
                   const std::uint32_t* alive, const std::uint32_t* unit_error, std::uint32_t* keys,
                   cudaStream_t stream);
// Makes dead[k] a clone of order[k], k < count.
void launch_replace(const Primitives& p, const std::uint32_t* order, const std::uint32_t* dead,
                    std::uint32_t count, RandomKey key, cudaStream_t stream);

// Caps the logit of every opacity.
void launch_reset_opacity(const Primitives& p, float cap, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
