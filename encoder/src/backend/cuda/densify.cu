// SPDX-License-Identifier: Apache-2.0
// Densification on the device: train/densify.cpp with one thread per primitive. A random number
// depends on the number of draws before it, which a prefix sum over the draws provides.
#include "backend/cuda/densify_kernels.h"
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kBlock = 128;

__device__ std::uint32_t thread_index() {
  return blockIdx.x * kBlock + threadIdx.x;
}

__device__ Vec3 read3(const float* array, std::uint32_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

__device__ int components(const Primitives& p, int attribute) {
  switch (attribute) {
    case kRotation:
      return 4;
    case kVelocity:
      return p.tick > 0.0f ? 4 : 3;
    case kPosition:
    case kLogScale:
      return 3;
    case kSh:
      return 3 * p.sh_coefficients;
    default:
      return 1;
  }
}

__device__ bool is_finite(const Primitives& p, std::uint32_t i) {
  for (int a = 0; a < kAttributes; ++a) {
    const int n = components(p, a);
    const float* values = p.values[a] + static_cast<std::size_t>(i) * n;
    for (int c = 0; c < n; ++c) {
      if (!isfinite(values[c])) return false;
    }
  }
  return isfinite(p.sigma[i]) && p.sigma[i] > 0.0f;
}

__device__ void add(std::uint32_t* total, bool one) {
  const unsigned mask = __ballot_sync(kAllLanes, one);
  if ((threadIdx.x & 31) == 0 && mask != 0) atomicAdd(total, __popc(mask));
}

__global__ void mark_survivors(const Primitives p, const DensifyRules rules, const FreeSpace space,
                               std::uint32_t* flags, DensifyTotals* totals) {
  const std::uint32_t i = thread_index();
  const bool fixed = i < p.n && p.updates[i] == kFixed;
  const bool valid = fixed || (i < p.n && is_finite(p, i));
  const bool survivor = fixed || (valid &&
                                  survives(rules, p.values[kOpacity][i], read3(p.log_scale, i),
                                           read3(p.values[kPosition], i)) &&
                                  !in_free_space(space, read3(p.values[kPosition], i)));
  if (i < p.n) flags[i] = survivor;
  add(&totals->survivors, survivor);
  add(&totals->non_finite, i < p.n && !valid);
}

__global__ void list_flagged(std::uint32_t n, const std::uint32_t* flags, std::uint32_t value,
                             const std::uint32_t* slots, std::uint32_t* list) {
  const std::uint32_t i = thread_index();
  if (i < n && flags[i] == value) list[slots[i]] = i;
}

__global__ void invert(std::uint32_t n, std::uint32_t* flags) {
  const std::uint32_t i = thread_index();
  if (i < n) flags[i] = 1 - flags[i];
}

__global__ void gather(const std::uint32_t* from, std::uint32_t* to, const std::uint32_t* list,
                       std::size_t n, int words) {
  const std::size_t e = std::size_t{blockIdx.x} * kBlock + threadIdx.x;
  if (e < n * words) to[e] = from[static_cast<std::size_t>(list[e / words]) * words + e % words];
}

__global__ void urgency(const Primitives p, const DensifyRules rules, std::uint32_t* keys,
                        DensifyTotals* totals) {
  const std::uint32_t i = thread_index();
  std::uint32_t key = 0xFFFFFFFFu;
  if (i < p.n && p.views[i] > 0 && p.updates[i] != kFixed) {
    const bool split = is_split(rules, read3(p.log_scale, i));
    const float u =
        growth_urgency(rules, split, p.gradient_sum[i], p.abs_gradient_sum[i], p.views[i]);
    if (u > 1.0f) key = ~__float_as_uint(u);
  }
  if (i < p.n) keys[i] = key;
  add(&totals->candidates, key != 0xFFFFFFFFu);
}

__global__ void choose(const Primitives p, const DensifyRules rules, const std::uint32_t* order,
                       std::uint32_t count, std::uint32_t* flags, std::uint32_t* draws,
                       DensifyTotals* totals) {
  const std::uint32_t k = thread_index();
  const bool chosen = k < count;
  const std::uint32_t i = chosen ? order[k] : 0;
  const bool split = chosen && is_split(rules, read3(p.log_scale, i));
  if (chosen) {
    flags[i] = 1;
    draws[i] = split ? kSplitDraws : (rules.plain ? 0 : kCloneDraws);
  }
  add(&totals->split, split);
}

// TrainState::clear_moments.
__device__ void clear_moments(const Primitives& p, std::uint32_t i) {
  for (int a = 0; a < kAttributes; ++a) {
    const int n = components(p, a);
    const std::size_t at = static_cast<std::size_t>(i) * n;
    for (int c = 0; c < n; ++c) p.first[a][at + c] = p.second[a][at + c] = 0.0f;
  }
  p.updates[i] = 0;
}

// TrainState::copy_parameters.
__device__ void copy_parameters(const Primitives& p, std::uint32_t from, std::uint32_t to) {
  for (int a = 0; a < kAttributes; ++a) {
    const std::size_t n = components(p, a);
    for (std::size_t c = 0; c < n; ++c) p.values[a][to * n + c] = p.values[a][from * n + c];
  }
  for (int c = 0; c < 3; ++c) p.u[3 * to + c] = p.u[3 * from + c];
  p.sigma[to] = p.sigma[from];
  if (p.tick > 0.0f) {
    for (int c = 0; c < 3; ++c) p.log_scale[3 * to + c] = p.log_scale[3 * from + c];
    for (int c = 0; c < 4; ++c) p.rotation[4 * to + c] = p.rotation[4 * from + c];
  }
  clear_moments(p, to);
}

__device__ void move_by_sample(const Primitives& p, std::uint32_t i, float factor, Random& random) {
  const float* q = p.rotation + std::size_t{4} * i;
  const Vec3 offset =
      gaussian_sample({q[0], q[1], q[2], q[3]}, read3(p.log_scale, i), factor, random);
  float* position = p.values[kPosition] + std::size_t{3} * i;
  position[0] += offset.x;
  position[1] += offset.y;
  position[2] += offset.z;
}

__device__ void clone_into(const Primitives& p, std::uint32_t from, std::uint32_t to,
                           Random& random) {
  p.values[kOpacity][from] = cloned_logit(p.values[kOpacity][from]);
  clear_moments(p, from);
  copy_parameters(p, from, to);
  move_by_sample(p, to, kCloneSpread, random);
}

__device__ void split_into(const Primitives& p, std::uint32_t from, std::uint32_t to,
                           Random& random) {
  clear_moments(p, from);
  copy_parameters(p, from, to);
  move_by_sample(p, to, 1.0f, random);
  move_by_sample(p, from, 1.0f, random);
  for (int c = 0; c < 3; ++c) {
    const float shrunk = p.values[kLogScale][3 * from + c] - logf(kSplitShrink);
    p.values[kLogScale][3 * from + c] = p.values[kLogScale][3 * to + c] = shrunk;
  }
}

__global__ void grow(const Primitives p, const DensifyRules rules, const std::uint32_t* flags,
                     const std::uint32_t* slots, const std::uint32_t* draws_before, RandomKey key) {
  const std::uint32_t i = thread_index();
  if (i >= p.n || flags[i] == 0) return;
  Random random(key.seed, key.iteration, RandomPurpose::kDensify);
  random.skip(draws_before[i]);
  const std::uint32_t to = p.n + slots[i];
  if (is_split(rules, read3(p.log_scale, i))) {
    split_into(p, i, to, random);
  } else if (rules.plain) {
    copy_parameters(p, i, to);  // the original keeps its moments, which separates them (3DGS)
  } else {
    clone_into(p, i, to, random);
  }
}

// Maps floats to unsigned integers of the same order.
__device__ std::uint32_t ordered_bits(float x) {
  const std::uint32_t bits = __float_as_uint(x);
  return bits >> 31 ? ~bits : bits | 0x80000000u;
}

__global__ void scores(const Primitives p, const ScoreRules rules, bool modulated,
                       const std::uint32_t* survivors, const std::uint32_t* unit_error,
                       std::uint32_t* keys) {
  const std::uint32_t i = thread_index();
  if (i >= p.n) return;
  const float unit_value = __uint_as_float(*unit_error);
  const float unit = unit_value > 0.0f ? 1.0f / unit_value : 0.0f;
  const float f = modulated ? lifespan_modulation(p.sigma[i], p.values[kRadius][i]) : 1.0f;
  const float score =
      densification_score(rules, p.error_max[i], unit, p.values[kOpacity][i], read3(p.v, i), f);
  keys[i] = survivors[i] && p.updates[i] != kFixed ? ~ordered_bits(score) : 0xFFFFFFFFu;
}

__global__ void replace(const Primitives p, const std::uint32_t* order, const std::uint32_t* dead,
                        std::uint32_t count, RandomKey key) {
  const std::uint32_t k = thread_index();
  if (k >= count) return;
  Random random(key.seed, key.iteration, RandomPurpose::kDensify);
  random.skip(std::uint64_t{k} * kCloneDraws);
  clone_into(p, order[k], dead[k], random);
}

__global__ void change_sources(const Primitives p, const RelocationArrays plan) {
  const std::uint32_t k = thread_index();
  if (k >= plan.source_count) return;
  const std::uint32_t i = plan.sources[k];
  p.values[kOpacity][i] = __uint_as_float(plan.logits[k]);
  for (int c = 0; c < 3; ++c)
    p.values[kLogScale][3 * i + c] += __uint_as_float(plan.log_shrinks[k]);
  clear_moments(p, i);
}

__global__ void copy_sources(const Primitives p, const RelocationArrays plan, RandomKey key) {
  const std::uint32_t k = thread_index();
  if (k >= plan.count) return;
  Random random(key.seed, key.iteration, RandomPurpose::kDensify);
  random.skip(std::uint64_t{k} * kCloneDraws);
  copy_parameters(p, plan.from[k], plan.to[k]);
  move_by_sample(p, plan.to[k], kCloneSpread, random);
}

__global__ void reset_opacity(const Primitives p, float cap) {
  const std::uint32_t i = thread_index();
  if (i >= p.n) return;
  if (p.values[kOpacity][i] <= cap || p.updates[i] == kFixed) return;
  p.values[kOpacity][i] = cap;
  p.first[kOpacity][i] = p.second[kOpacity][i] = 0.0f;
}

}  // namespace

void launch_mark_survivors(const Primitives& p, const DensifyRules& rules, const FreeSpace& space,
                           std::uint32_t* flags, DensifyTotals* totals, cudaStream_t stream) {
  mark_survivors<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, rules, space, flags, totals);
}

void launch_list(std::uint32_t n, const std::uint32_t* flags, std::uint32_t value,
                 const std::uint32_t* slots, std::uint32_t* list, cudaStream_t stream) {
  list_flagged<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(n, flags, value, slots, list);
}

void launch_invert(std::uint32_t n, std::uint32_t* flags, cudaStream_t stream) {
  invert<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(n, flags);
}

void launch_gather(const std::uint32_t* from, std::uint32_t* to, const std::uint32_t* list,
                   std::size_t n, int words, cudaStream_t stream) {
  gather<<<blocks_of(n * words, kBlock), kBlock, 0, stream>>>(from, to, list, n, words);
}

void launch_urgency(const Primitives& p, const DensifyRules& rules, std::uint32_t* keys,
                    DensifyTotals* totals, cudaStream_t stream) {
  urgency<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, rules, keys, totals);
}

void launch_choose(const Primitives& p, const DensifyRules& rules, const std::uint32_t* order,
                   std::uint32_t count, std::uint32_t* flags, std::uint32_t* draws,
                   DensifyTotals* totals, cudaStream_t stream) {
  cudaMemsetAsync(flags, 0, p.n * sizeof(std::uint32_t), stream);
  cudaMemsetAsync(draws, 0, p.n * sizeof(std::uint32_t), stream);
  choose<<<blocks_of(count, kBlock), kBlock, 0, stream>>>(p, rules, order, count, flags, draws,
                                                          totals);
}

void launch_grow(const Primitives& p, const DensifyRules& rules, const std::uint32_t* flags,
                 const std::uint32_t* slots, const std::uint32_t* draws_before, RandomKey key,
                 cudaStream_t stream) {
  grow<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, rules, flags, slots, draws_before, key);
}

void launch_scores(const Primitives& p, const ScoreRules& rules, bool modulated,
                   const std::uint32_t* survivors, const std::uint32_t* unit_error,
                   std::uint32_t* keys, cudaStream_t stream) {
  scores<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, rules, modulated, survivors, unit_error,
                                                        keys);
}

void launch_replace(const Primitives& p, const std::uint32_t* order, const std::uint32_t* dead,
                    std::uint32_t count, RandomKey key, cudaStream_t stream) {
  replace<<<blocks_of(count, kBlock), kBlock, 0, stream>>>(p, order, dead, count, key);
}

void launch_relocate(const Primitives& p, const RelocationArrays& plan, RandomKey key,
                     cudaStream_t stream) {
  change_sources<<<blocks_of(plan.source_count, kBlock), kBlock, 0, stream>>>(p, plan);
  copy_sources<<<blocks_of(plan.count, kBlock), kBlock, 0, stream>>>(p, plan, key);
}

void launch_reset_opacity(const Primitives& p, float cap, cudaStream_t stream) {
  reset_opacity<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, cap);
}

}  // namespace stgs::encoder::cuda
