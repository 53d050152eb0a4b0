// SPDX-License-Identifier: Apache-2.0
// Velocities of the points of many frames on a GPU, from their nearest neighbours in other frames
// (velocity_rule.h). The reference on the CPU is init/velocity_match.h.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "geometry/velocity_rule.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// The points of frame `from` that are matched with those of frame `to`; indices of the problem.
struct FramePair {
  std::size_t from = 0, to = 0;
  std::vector<math::Vec3> steps{};  // result, per point of `from`, scene units; NaN: unknown
};

struct VelocityProblem {
  std::vector<std::vector<MatchPoint>> frames;
  std::vector<FramePair> pairs;
  double reach = 0;  // longest step, scene units
};

// The cost of a pair on a GPU, which compares each point with all others.
struct PairCost {
  std::uint64_t comparisons = 0;  // of two points
  std::uint64_t bytes = 0;        // of GPU memory
};
inline PairCost pair_cost(std::size_t from, std::size_t to) {
  constexpr std::uint64_t kPerPoint =
      kWideNeighbours * sizeof(std::uint32_t) + sizeof(std::uint8_t) + 2 * sizeof(math::Vec3);
  return {from * (from + kMatchRounds * to), from * kPerPoint + (from + to) * sizeof(MatchPoint)};
}

// Limits of the pairs of a problem together. The comparisons are those of two frames of 100000
// points, for which an H200 takes 0.06 s, and 16 cores with k-d trees 0.3 s. On a GPU the time
// grows with the square of the points, so that with larger frames a slower GPU takes longer than a
// CPU.
inline constexpr PairCost kMaxProblemCost{70'000'000'000, std::uint64_t{256} << 20};
inline constexpr std::size_t kMaxProblemPairs = 4096;

class VelocityMatcher {
 public:
  virtual ~VelocityMatcher() = default;
  virtual std::string name() const = 0;
  // Fills the steps of all pairs of a problem within the limits, one problem at a time. Keeps its
  // GPU memory for later problems. Thread-safe. kRuntime if the GPU fails.
  virtual Status run(VelocityProblem& problem) = 0;
};

// On GPU number `gpu` modulo the number of GPUs. kNotBuilt without CUDA, kUnsupported without one.
Result<std::unique_ptr<VelocityMatcher>> make_cuda_velocity_matcher(int gpu);
// `backend`: "cpu", "cuda" or "auto", which is CUDA if it can be used, and else the CPU, with a
// line in `log`. Returns null for the CPU.
Result<std::unique_ptr<VelocityMatcher>> make_velocity_matcher(const std::string& backend, int gpu,
                                                               const LogSink& log);

}  // namespace stgs::encoder::geometry
