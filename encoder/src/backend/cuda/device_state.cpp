// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/device_state.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "stgs/format/parallel.h"

namespace stgs::encoder::cuda {
namespace {

constexpr std::size_t kAlignment = 64;                // of each array, words
constexpr std::size_t kChunk = std::size_t{1} << 18;  // words per copy task
constexpr int kMapWords = 12;

std::size_t aligned(std::size_t words) {
  return (words + kAlignment - 1) / kAlignment * kAlignment;
}

// Copies with all cores, because a single one is slower than the bus.
void copy(std::uint32_t* to, const std::uint32_t* from, std::size_t words) {
  parallel_blocks(std::size_t{0}, words, kChunk, [&](std::size_t first, std::size_t last) {
    std::memcpy(to + first, from + first, (last - first) * sizeof(std::uint32_t));
  });
}

template <typename Array>
std::uint32_t* words_of(Array& array) {
  static_assert(sizeof(typename Array::value_type) % sizeof(std::uint32_t) == 0);
  return reinterpret_cast<std::uint32_t*>(array.data());
}

// Returns the words per primitive of each array, in the order of arrays().
std::vector<int> widths(int sh_coefficients, bool coupled) {
  TrainState state;
  state.coupled.tick = coupled ? 1.0f : 0.0f;
  std::vector<int> all;
  for (int a = 0; a < kAttributes; ++a) {
    all.insert(all.end(), 3, a == kSh ? 3 * sh_coefficients : state.components(a));
  }
  const int rest[] = {3, 1, 1, 1, 1, 1, 1};  // u, sigma, updates, statistics
  all.insert(all.end(), std::begin(rest), std::end(rest));
  if (coupled) all.insert(all.end(), {3, 4});  // rendered scales and rotation
  return all;
}

// Returns the words of the rounded values of n primitives: positions, scales, rotations, opacities,
// SH and velocities.
std::size_t rounded_words(std::size_t n, int sh_coefficients) {
  std::size_t words = 0;
  for (int width : {3, 3, 4, 1, 3 * sh_coefficients, 3})
    words += aligned(n * static_cast<std::size_t>(width));
  return words;
}

}  // namespace

std::size_t DeviceState::bytes(std::size_t n, int sh_coefficients, bool coupled, bool rounding) {
  std::size_t words = rounding ? rounded_words(n, sh_coefficients) + n : 0;
  for (int width : widths(sh_coefficients, coupled))
    words += aligned(n * static_cast<std::size_t>(width));
  return words * sizeof(std::uint32_t);
}

Status DeviceState::reserve(std::size_t n, int sh_coefficients, bool coupled) {
  const bool same = sh_coefficients == primitives_.sh_coefficients && coupled == coupled_;
  if (n <= capacity_ && same) return {};
  capacity_ = 0;
  STGS_TRY(memory_.ensure(bytes(n, sh_coefficients, coupled, false) / sizeof(std::uint32_t)));
  STGS_TRY(staging_.ensure(bytes(n, sh_coefficients, coupled, false) / sizeof(std::uint32_t)));
  arrays_.clear();
  std::size_t at = 0;
  for (int width : widths(sh_coefficients, coupled)) {
    arrays_.push_back({memory_.data() + at, width});
    at += aligned(n * static_cast<std::size_t>(width));
  }
  capacity_ = n;
  coupled_ = coupled;
  primitives_ = {};
  primitives_.sh_coefficients = sh_coefficients;
  const auto floats = [&](int k) { return reinterpret_cast<float*>(arrays_[k].data); };
  for (int a = 0; a < kAttributes; ++a) {
    primitives_.values[a] = floats(3 * a);
    primitives_.first[a] = floats(3 * a + 1);
    primitives_.second[a] = floats(3 * a + 2);
  }
  constexpr int kRest = 3 * kAttributes;
  primitives_.u = floats(kRest);
  primitives_.sigma = floats(kRest + 1);
  primitives_.updates = arrays_[kRest + 2].data;
  primitives_.gradient_sum = floats(kRest + 3);
  primitives_.abs_gradient_sum = floats(kRest + 4);
  primitives_.error_max = floats(kRest + 5);
  primitives_.views = arrays_[kRest + 6].data;
  primitives_.log_scale = coupled ? floats(kRest + 7) : primitives_.values[kLogScale];
  primitives_.rotation = coupled ? floats(kRest + 8) : primitives_.values[kRotation];
  primitives_.rendered = learnt();
  primitives_.v = coupled ? primitives_.u : primitives_.values[kVelocity];
  return {};
}

Rendered DeviceState::learnt() const {
  const Primitives& p = primitives_;
  return {p.values[kPosition], p.log_scale, p.rotation, p.values[kOpacity], p.values[kSh], p.u};
}

Status DeviceState::reserve_rounding(std::size_t n) {
  STGS_TRY(rounded_memory_.ensure(rounded_words(n, primitives_.sh_coefficients)));
  STGS_TRY(rules_memory_.ensure(1));
  return tier_memory_.ensure(n);
}

Status DeviceState::upload_rounding(const TrainState& state, cudaStream_t stream) {
  const CompactionState& compaction = state.compaction;
  primitives_.rendered = learnt();
  primitives_.rules = nullptr;
  if (!compaction.is_rounding()) return {};
  const std::size_t n = state.size();
  STGS_TRY(reserve_rounding(n));
  float* at = rounded_memory_.data();
  const auto take = [&at, n](std::size_t components) {
    float* const out = at;
    at += aligned(n * components);
    return out;
  };
  rounded_ = {
      take(3), take(3), take(4), take(1), take(std::size_t{3} * primitives_.sh_coefficients),
      take(3)};
  primitives_.rendered = {rounded_.position, rounded_.log_scale, rounded_.rotation,
                          rounded_.opacity,  rounded_.sh,        rounded_.u};
  // The sources are pageable, so the calls return after reading them.
  STGS_TRY(cuda_status(cudaMemcpyAsync(rules_memory_.data(), &compaction.rules,
                                       sizeof(RoundingRules), cudaMemcpyHostToDevice, stream),
                       "uploading the steps"));
  STGS_TRY(cuda_status(cudaMemcpyAsync(tier_memory_.data(), compaction.tier.data(), n,
                                       cudaMemcpyHostToDevice, stream),
                       "uploading the tiers"));
  primitives_.rules = rules_memory_.data();
  primitives_.tier = tier_memory_.data();
  round(stream);
  return cuda_status(cudaGetLastError(), "rounding the primitives");
}

std::vector<std::uint32_t*> DeviceState::host_arrays(TrainState& state) {
  std::vector<std::uint32_t*> all;
  for (int a = 0; a < kAttributes; ++a) {
    all.push_back(words_of(state.values(a)));
    all.push_back(words_of(state.moments[a].first));
    all.push_back(words_of(state.moments[a].second));
  }
  all.push_back(words_of(state.set.velocity));
  all.push_back(words_of(state.set.sigma));
  all.push_back(words_of(state.updates));
  all.push_back(words_of(state.statistics.gradient_sum));
  all.push_back(words_of(state.statistics.abs_gradient_sum));
  all.push_back(words_of(state.statistics.error_max));
  all.push_back(words_of(state.statistics.views));
  if (state.is_coupled()) {
    all.push_back(words_of(state.set.log_scale));
    all.push_back(words_of(state.set.rotation));
  }
  return all;
}

Status DeviceState::upload(const TrainState& state, cudaStream_t stream) {
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "waiting for the GPU"));
  STGS_TRY(
      reserve(std::max(state.size(), capacity_), state.set.sh_coefficients(), state.is_coupled()));
  primitives_.tick = state.coupled.tick;
  primitives_.fixed = static_cast<std::uint32_t>(state.count_fixed());
  resize(state.size());
  // The const_cast is safe, because the arrays are only read.
  const std::vector<std::uint32_t*> host = host_arrays(const_cast<TrainState&>(state));
  std::uint32_t* staged = staging_.data();
  for (std::size_t k = 0; k < host.size(); ++k) {
    const std::size_t words = state.size() * static_cast<std::size_t>(arrays_[k].words);
    if (words == 0) continue;
    copy(staged, host[k], words);
    STGS_TRY(cuda_status(cudaMemcpyAsync(arrays_[k].data, staged, words * sizeof(std::uint32_t),
                                         cudaMemcpyHostToDevice, stream),
                         "uploading the state"));
    staged += words;
  }
  if (coupled_) launch_derive_coupled(primitives_, stream);
  STGS_TRY(upload_rounding(state, stream));
  return upload_colour(state, stream);
}

Status DeviceState::download(TrainState& state, cudaStream_t stream) {
  state.resize(primitives_.n);
  const std::vector<std::uint32_t*> host = host_arrays(state);
  std::uint32_t* staged = staging_.data();
  for (const Array& array : arrays_) {
    const std::size_t words = state.size() * static_cast<std::size_t>(array.words);
    if (words == 0) continue;
    STGS_TRY(cuda_status(cudaMemcpyAsync(staged, array.data, words * sizeof(std::uint32_t),
                                         cudaMemcpyDeviceToHost, stream),
                         "downloading the state"));
    staged += words;
  }
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "downloading the state"));
  staged = staging_.data();
  for (std::size_t k = 0; k < host.size(); ++k) {
    const std::size_t words = state.size() * static_cast<std::size_t>(arrays_[k].words);
    copy(host[k], staged, words);
    staged += words;
  }
  if (coupled_) {
    state.velocity = state.set.velocity;
    std::transform(state.set.sigma.begin(), state.set.sigma.end(), state.log_sigma.begin(),
                   [](float sigma) { return std::log(sigma); });
  }
  return download_colour(state);
}

std::vector<ColourMap>* DeviceState::colour_arrays(TrainState& state, int which) {
  std::vector<ColourMap>* const arrays[] = {&state.colour, &state.colour_first,
                                            &state.colour_second};
  return arrays[which];
}

Status DeviceState::upload_colour(const TrainState& state, cudaStream_t stream) {
  const std::size_t cameras = state.colour.size(), words = kMapWords * cameras;
  STGS_TRY(colour_memory_.ensure(3 * words + cameras));
  std::uint32_t* at = colour_memory_.data();
  float** const pointers[] = {&colour_.map, &colour_.first, &colour_.second};
  colour_.cameras = static_cast<std::uint32_t>(cameras);
  for (int k = 0; k < 3; ++k, at += words) {
    *pointers[k] = reinterpret_cast<float*>(at);
    // The source is pageable, so the call returns after reading it.
    STGS_TRY(
        cuda_status(cudaMemcpyAsync(at, colour_arrays(const_cast<TrainState&>(state), k)->data(),
                                    words * sizeof(std::uint32_t), cudaMemcpyHostToDevice, stream),
                    "uploading the colour maps"));
  }
  colour_.updates = at;
  return cuda_status(
      cudaMemcpyAsync(at, state.colour_updates.data(), cameras * sizeof(std::uint32_t),
                      cudaMemcpyHostToDevice, stream),
      "uploading the colour maps");
}

Status DeviceState::download_colour(TrainState& state) {
  const float* const pointers[] = {colour_.map, colour_.first, colour_.second};
  for (int k = 0; k < 3; ++k) {
    STGS_TRY(cuda_status(cudaMemcpy(colour_arrays(state, k)->data(), pointers[k],
                                    colour_.cameras * sizeof(ColourMap), cudaMemcpyDeviceToHost),
                         "downloading the colour maps"));
  }
  return cuda_status(cudaMemcpy(state.colour_updates.data(), colour_.updates,
                                colour_.cameras * sizeof(std::uint32_t), cudaMemcpyDeviceToHost),
                     "downloading the colour maps");
}

}  // namespace stgs::encoder::cuda
