// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/densifier.h"

#include <algorithm>
#include <vector>

#include "train/relocation.h"

namespace stgs::encoder::cuda {
namespace {

constexpr int kAllBits = 32;

template <typename T>
Status read_array(const T* from, std::vector<T>& to, cudaStream_t stream) {
  return cuda_status(
      cudaMemcpyAsync(to.data(), from, to.size() * sizeof(T), cudaMemcpyDeviceToHost, stream),
      "reading the statistics of densification");
}

// Writes into an array of 4-byte items.
template <typename T>
Status write_array(const std::vector<T>& from, void* to, cudaStream_t stream) {
  static_assert(sizeof(T) == 4);
  return cuda_status(
      cudaMemcpyAsync(to, from.data(), from.size() * sizeof(T), cudaMemcpyHostToDevice, stream),
      "writing a relocation");
}

}  // namespace

Status Densifier::create() {
  STGS_TRY(totals_.ensure(1));
  return host_totals_.ensure(1);
}

Status Densifier::clear_totals(cudaStream_t stream) {
  return cuda_status(cudaMemsetAsync(totals_.data(), 0, sizeof(DensifyTotals), stream),
                     "clearing the counts of densification");
}

Result<DensifyTotals> Densifier::read_totals(cudaStream_t stream) {
  STGS_TRY(cuda_status(cudaGetLastError(), "starting to densify"));
  STGS_TRY(cuda_status(cudaMemcpyAsync(host_totals_.data(), totals_.data(), sizeof(DensifyTotals),
                                       cudaMemcpyDeviceToHost, stream),
                       "reading the counts of densification"));
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "densifying"));
  return *host_totals_.data();
}

// Compacts the state to the `survivors` primitives flagged in w.flags.
Status Densifier::compact(DeviceState& state, std::size_t survivors, const Workspace& w,
                          cudaStream_t stream) {
  const std::uint32_t n = state.primitives().n;
  exclusive_sum(w, w.flags, w.offsets, n, stream);
  launch_list(n, w.flags, 1, w.offsets, w.order, stream);
  // Every array fits in the partial sums of the tile instances, which are unused between steps.
  auto* compacted = reinterpret_cast<std::uint32_t*>(w.partials);
  for (const DeviceState::Array& array : state.arrays()) {
    const std::size_t words = survivors * static_cast<std::size_t>(array.words);
    launch_gather(array.data, compacted, w.order, survivors, array.words, stream);
    STGS_TRY(cuda_status(cudaMemcpyAsync(array.data, compacted, words * sizeof(std::uint32_t),
                                         cudaMemcpyDeviceToDevice, stream),
                         "compacting the primitives"));
  }
  state.resize(survivors);
  return {};
}

Status Densifier::reset_statistics(const Primitives& p, cudaStream_t stream) {
  void* const arrays[] = {p.gradient_sum, p.abs_gradient_sum, p.error_max, p.views};
  for (void* array : arrays) {
    STGS_TRY(cuda_status(cudaMemsetAsync(array, 0, p.n * sizeof(float), stream),
                         "clearing the statistics"));
  }
  return {};
}

Result<DensifyCounts> Densifier::grow(DeviceState& state, const HyperParameters& parameters,
                                      const DensifyContext& context, std::uint64_t iteration,
                                      const Workspace& w, cudaStream_t stream) {
  const DensifyRules rules = densify_rules(parameters, context);
  const std::size_t before = state.primitives().n;
  STGS_TRY(clear_totals(stream));
  launch_mark_survivors(state.primitives(), rules, context.free_space, w.flags, totals_.data(),
                        stream);
  STGS_ASSIGN(DensifyTotals totals, read_totals(stream));
  DensifyCounts counts;
  counts.non_finite = totals.non_finite;
  counts.removed = before - totals.survivors;
  if (counts.removed > 0) STGS_TRY(compact(state, totals.survivors, w, stream));

  launch_urgency(state.primitives(), rules, w.depth_keys, totals_.data(), stream);
  sort_indices(w, w.depth_keys, w.keys_sorted, w.order, totals.survivors, kAllBits, stream);
  STGS_ASSIGN(totals, read_totals(stream));
  const std::size_t present = state.primitives().n;
  const std::size_t chosen = std::min<std::size_t>(
      totals.candidates, max_growth(parameters, context, present, state.primitives().fixed));
  launch_choose(state.primitives(), rules, w.order, static_cast<std::uint32_t>(chosen), w.flags,
                w.depth_keys, totals_.data(), stream);
  exclusive_sum(w, w.flags, w.offsets, present, stream);
  exclusive_sum(w, w.depth_keys, w.keys_sorted, present, stream);
  launch_grow(state.primitives(), rules, w.flags, w.offsets, w.keys_sorted,
              {context.seed, iteration}, stream);
  STGS_ASSIGN(totals, read_totals(stream));
  counts.split = totals.split;
  counts.cloned = chosen - totals.split;
  state.resize(present + chosen);
  STGS_TRY(reset_statistics(state.primitives(), stream));
  return counts;
}

Result<DensifyCounts> Densifier::replace(DeviceState& state, const HyperParameters& parameters,
                                         const DensifyContext& context, std::uint64_t iteration,
                                         const Workspace& w, cudaStream_t stream) {
  DensifyCounts counts;
  const Primitives& p = state.primitives();
  if (p.n == 0) return counts;
  const DensifyRules rules = densify_rules(parameters, context);
  STGS_TRY(clear_totals(stream));
  launch_mark_survivors(p, rules, context.free_space, w.flags, totals_.data(), stream);
  // E's 99th percentile counts as 1. Errors are not negative, so they sort like their bits.
  const auto* errors = reinterpret_cast<const std::uint32_t*>(p.error_max);
  sort_indices(w, errors, w.keys_sorted, w.order, p.n, kAllBits, stream);
  const ScoreRules score{parameters.score_error, parameters.score_opacity,
                         parameters.score_lifespan};
  launch_scores(p, score, context.modulated, w.flags, w.keys_sorted + unit_error_rank(p.n, p.fixed),
                w.depth_keys, stream);
  sort_indices(w, w.depth_keys, w.keys_sorted, w.order, p.n, kAllBits, stream);
  auto* dead = reinterpret_cast<std::uint32_t*>(w.ranges);
  launch_invert(p.n, w.flags, stream);
  exclusive_sum(w, w.flags, w.offsets, p.n, stream);
  launch_list(p.n, w.flags, 1, w.offsets, dead, stream);
  STGS_ASSIGN(const DensifyTotals totals, read_totals(stream));
  counts.non_finite = totals.non_finite;
  counts.replaced =
      max_replacements(parameters, totals.survivors - p.fixed, p.n - totals.survivors);
  launch_replace(p, w.order, dead, static_cast<std::uint32_t>(counts.replaced),
                 {context.seed, iteration}, stream);
  STGS_TRY(cuda_status(cudaGetLastError(), "replacing primitives"));
  STGS_TRY(reset_statistics(p, stream));
  return counts;
}

Result<DensifyCounts> Densifier::relocate(DeviceState& state, const HyperParameters& parameters,
                                          const DensifyContext& context, std::uint64_t iteration,
                                          const Workspace& w, cudaStream_t stream) {
  DensifyCounts counts;
  const Primitives& p = state.primitives();
  STGS_TRY(clear_totals(stream));
  const DensifyRules rules = densify_rules(parameters, context);
  launch_mark_survivors(p, rules, context.free_space, w.flags, totals_.data(), stream);
  std::vector<std::uint32_t> survives(p.n), views(p.n), updates(p.n);
  std::vector<float> logits(p.n), gradients(p.n);
  STGS_TRY(read_array(w.flags, survives, stream));
  STGS_TRY(read_array(p.views, views, stream));
  STGS_TRY(read_array(p.updates, updates, stream));
  STGS_TRY(read_array(p.values[kOpacity], logits, stream));
  STGS_TRY(read_array(p.gradient_sum, gradients, stream));
  STGS_ASSIGN(const DensifyTotals totals, read_totals(stream));
  for (std::size_t i = 0; i < p.n; ++i) {
    if (updates[i] == kFixed) survives[i] = kFixedSurvivor;
  }
  const Relocation plan =
      plan_relocation(logits, gradients, views, survives, rules.prune_opacity,
                      Random(context.seed, iteration, RandomPurpose::kRelocation));
  counts.non_finite = totals.non_finite;
  counts.replaced = plan.to.size();
  STGS_TRY(write_array(plan.sources, w.flags, stream));
  STGS_TRY(write_array(plan.logits, w.depth_keys, stream));
  STGS_TRY(write_array(plan.log_shrinks, w.keys_sorted, stream));
  STGS_TRY(write_array(plan.from, w.order, stream));
  STGS_TRY(write_array(plan.to, w.offsets, stream));
  launch_relocate(
      p,
      {static_cast<std::uint32_t>(plan.sources.size()), static_cast<std::uint32_t>(plan.to.size()),
       w.flags, w.depth_keys, w.keys_sorted, w.order, w.offsets},
      {context.seed, iteration}, stream);
  STGS_TRY(cuda_status(cudaGetLastError(), "relocating primitives"));
  STGS_TRY(reset_statistics(p, stream));
  // The copies read the plan.
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "relocating primitives"));
  return counts;
}

}  // namespace stgs::encoder::cuda
