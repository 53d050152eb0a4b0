// SPDX-License-Identifier: Apache-2.0
// Launch functions of the densification kernels, and their counters.
#pragma once

#include "backend/cuda/kernels.h"
#include "train/densify_rules.h"

namespace stgs::encoder::cuda {

// Filled by the kernels below, on the device.
struct DensifyTotals {
  std::uint32_t survivors, non_finite;
  std::uint32_t candidates;  // for growth
  std::uint32_t split;       // of the chosen candidates
};

struct RandomKey {
  std::uint64_t seed, iteration;
};

// Sets flags[i] to 1 if primitive i survives pruning, else 0; counts survivors and non_finite.
void launch_mark_survivors(const Primitives& p, const DensifyRules& rules, const FreeSpace& space,
                           std::uint32_t* flags, DensifyTotals* totals, cudaStream_t stream);
// Lists the primitives whose flag equals `value`: list[slots[i]] = i.
void launch_list(std::uint32_t n, const std::uint32_t* flags, std::uint32_t value,
                 const std::uint32_t* slots, std::uint32_t* list, cudaStream_t stream);
// Sets flags[i] = 1 - flags[i].
void launch_invert(std::uint32_t n, std::uint32_t* flags, cudaStream_t stream);
// Copies to[k] = from[list[k]], `words` words per entry.
void launch_gather(const std::uint32_t* from, std::uint32_t* to, const std::uint32_t* list,
                   std::size_t n, int words, cudaStream_t stream);

// Computes sort keys of growth: the smaller, the more urgent; ~0 for primitives that are no
// candidates. Counts candidates.
void launch_urgency(const Primitives& p, const DensifyRules& rules, std::uint32_t* keys,
                    DensifyTotals* totals, cudaStream_t stream);
// Sets flags and draws (random numbers consumed) of the first `count` of order, 0 for all others.
void launch_choose(const Primitives& p, const DensifyRules& rules, const std::uint32_t* order,
                   std::uint32_t count, std::uint32_t* flags, std::uint32_t* draws,
                   DensifyTotals* totals, cudaStream_t stream);
// Clones or splits the flagged primitives into n + slots[i].
void launch_grow(const Primitives& p, const DensifyRules& rules, const std::uint32_t* flags,
                 const std::uint32_t* slots, const std::uint32_t* draws_before, RandomKey key,
                 cudaStream_t stream);

// Computes sort keys of replacement: the smaller, the higher the score; ~0 for primitives that do
// not survive. *unit_error: the error that counts as 1, as the bits of a float.
void launch_scores(const Primitives& p, const ScoreRules& rules, bool modulated,
                   const std::uint32_t* survivors, const std::uint32_t* unit_error,
                   std::uint32_t* keys, cudaStream_t stream);
// Replaces dead[k] with a clone of order[k], k < count.
void launch_replace(const Primitives& p, const std::uint32_t* order, const std::uint32_t* dead,
                    std::uint32_t count, RandomKey key, cudaStream_t stream);

// Device arrays of a Relocation (train/relocation.h); logits and log_shrinks are bits of floats.
struct RelocationArrays {
  std::uint32_t source_count, count;
  const std::uint32_t *sources, *logits, *log_shrinks;
  const std::uint32_t *from, *to;
};
// Changes the sources, then copies them.
void launch_relocate(const Primitives& p, const RelocationArrays& plan, RandomKey key,
                     cudaStream_t stream);

// Caps the logit of every opacity.
void launch_reset_opacity(const Primitives& p, float cap, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
