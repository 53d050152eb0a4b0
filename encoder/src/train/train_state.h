// SPDX-License-Identifier: Apache-2.0
// All state that training changes: parameters, Adam moments, densification statistics and colour
// corrections. A checkpoint stores it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "math/damp.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/lang.h"
#include "train/rounding.h"

namespace stgs::encoder {

// Learnt attributes, in the order of TrainState::moments.
enum Attribute : int {
  kPosition,
  kLogScale,
  kRotation,
  kOpacity,
  kSh,
  kTime,
  kVelocity,
  kLogSigma,
  kRadius,
  kAttributes,
};

// Adam's running means of the gradient and of its square, with the shape of the attribute.
struct Moments {
  std::vector<float> first, second;
};

// Accumulated for each primitive between two densification steps.
struct DensifyStatistics {
  std::vector<float> gradient_sum;      // of |dL/d(image position)|, half image widths
  std::vector<float> abs_gradient_sum;  // the same with per-pixel absolute values (AbsGS)
  std::vector<float> error_max;         // E: largest contribution to the error of a view
  std::vector<std::uint32_t> views;     // number of views in which it was visible

  void reset(std::size_t n);
};

// Affine colour correction of a camera: corrected = matrix colour + offset; row-major 3x3 then 3.
using ColourMap = std::array<float, 12>;
inline constexpr ColourMap kIdentityColour = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

// Correction of a training camera (camera_refinement.h): c' = exp([turn]) c + shift for points c in
// camera space, turn in radians and shift in scene units, then the logarithm of the focal factor,
// the lens (math/lens.h), and by how many frames its images are taken later than stated.
using CameraCorrection = std::array<float, 10>;
inline constexpr std::size_t kTurn = 0, kShift = 3, kLogFocal = 6, kDistortion = 7, kVignetting = 8,
                             kTimeShift = 9;
inline constexpr float kMaxDistortion = 0.3f, kMaxVignetting = 0.6f;  // absolute values
inline constexpr float kMaxTimeShift = 1.0f;                          // absolute value, frames

// The updates of a fixed primitive: it is rendered, but steps and densification leave it as it is.
inline constexpr std::uint32_t kFixed = 0xFFFFFFFF;

struct CoupledParameters {
  float tick = 0;        // units of time per frame; 0: not in use, all arrays are empty
  FloatArray log_scale;  // N x 3, kLogScale
  FloatArray left;       // N x 4, kRotation
  FloatArray right;      // N x 4, kVelocity; time and space mix where it differs from left's
  FloatArray log_time;   // N, kLogSigma
};

// The state of the compaction at the end of a run (compaction.h).
struct CompactionState {
  std::uint32_t prunings = 0;  // done
  // Chosen before the first one: the fraction of the primitives to keep, and the quality.
  double keep = 0, quality = 0;
  double psnr = 0;  // of the training images before the latest pruning, with a target; dB
  // Set once rounding has begun: its steps, and the importance and tier of each primitive.
  std::optional<Quantisation> quantisation;
  RoundingRules rules;
  std::vector<float> importance;
  std::vector<std::uint8_t> tier;

  bool is_rounding() const { return quantisation.has_value(); }
};

struct TrainState {
  // set.velocity and set.sigma are derived (effective velocity v / f, exp(log_sigma)); the rest of
  // the set is learnt directly.
  Gaussians4D set;
  FloatArray velocity;   // N x 3, v of the paper; scene units per frame
  FloatArray log_sigma;  // N, log frames
  // With the paper's representation ablated, the learnt form of 4DGS (encoder/math/coupled.h), from
  // which scales, rotation, velocity and sigma are derived.
  CoupledParameters coupled;
  std::array<Moments, kAttributes> moments;
  std::vector<std::uint32_t> updates;  // N, Adam steps of each primitive, or kFixed
  DensifyStatistics statistics;

  CompactionState compaction;
  math::Vec3 background{0.0f, 0.0f, 0.0f};  // behind everything, sRGB-encoded
  std::vector<ColourMap> colour;            // one per training camera
  std::vector<ColourMap> colour_first, colour_second;
  std::vector<std::uint32_t> colour_updates;
  // One per training camera; empty if cameras are not refined.
  std::vector<CameraCorrection> cameras, cameras_first, cameras_second;
  std::vector<std::uint32_t> camera_updates;
  std::vector<CameraCorrection> camera_sums;  // of the gradients of views since the last update
  std::vector<std::uint32_t> camera_views;    // their number

  std::uint64_t iteration = 0;
  std::uint32_t second_stage = 0;    // 1: L_opacity is on
  std::uint32_t opacity_resets = 0;  // done so far
  double seconds = 0;                // spent so far
  double mean_loss = 0;              // running mean

  std::size_t size() const { return log_sigma.size(); }
  bool is_fixed(std::size_t i) const { return updates[i] == kFixed; }
  // Returns the number of fixed primitives.
  std::size_t count_fixed() const;
  // Lists the others.
  std::vector<std::uint32_t> list_trained() const;
  // Returns the number of values of an attribute per primitive.
  int components(int attribute) const;
  // Returns the values of an attribute.
  FloatArray& values(int attribute);
  const FloatArray& values(int attribute) const;

  void resize(std::size_t n);
  // Returns a new state without primitives, with the representation, SH degree, background, colours
  // and cameras of this one. Cameras have not been refined yet in it.
  TrainState without_primitives() const;
  bool is_coupled() const { return coupled.tick > 0; }
  // Applies math::damped_velocity to primitive i. `before`: the modulation f before the step.
  void damp(std::size_t i, float before, bool modulated, const math::DampingRules& rules);
  // Recomputes set.velocity and set.sigma of primitive i; modulated = false means f = 1. A coupled
  // state recomputes everything that derives from the coupled form.
  void derive(std::size_t i, bool modulated);
  void derive_all(bool modulated);
  // Retains the listed primitives, in that order.
  void retain(const std::vector<std::uint32_t>& indices);
  // Overwrites primitive `to` with the parameters of `from`; its moments and updates restart at 0.
  void copy_parameters(std::size_t from, std::size_t to);
  void clear_moments(std::size_t i);
  // Overwrites the primitives from `to` on with the parameters of the primitives [begin, end) of a
  // state with the same representation and SH degree. Their moments and updates remain.
  void copy_parameters(const TrainState& from, std::size_t begin, std::size_t end, std::size_t to);
};

// Returns the set of a state that is being rounded as its views render it.
Gaussians4D rounded_set(const TrainState& state);

}  // namespace stgs::encoder
