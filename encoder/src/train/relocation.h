// SPDX-License-Identifier: Apache-2.0
// Relocation, the densification of FreeTimeGS (section 3.3 there): faint primitives move to places
// where opaque ones have large gradients. Opacities and scales change as in 3DGS-MCMC (Kheradmand
// et al., NeurIPS 2024, eq. 9), so that the render changes little.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "train/densify.h"

namespace stgs::encoder {

// Marks a fixed primitive, which is neither replaced nor a source.
inline constexpr std::uint32_t kFixedSurvivor = 2;

// The changes of one relocation, which the backends apply to their states.
struct Relocation {
  // Primitive to[k] becomes a copy of from[k], which may occur several times.
  std::vector<std::uint32_t> from, to;
  // The primitives in `from`, ascending, with their new opacity logits and the change of their
  // logarithmic scales, which their copies share.
  std::vector<std::uint32_t> sources;
  std::vector<float> logits, log_shrinks;
};

// Samples a source for every primitive that does not survive, with probability
// O / sum(O) + g / sum(g) among the survivors; g is the mean gradient with respect to the image
// position. All spans have one entry per primitive; `survives` is 0, 1 or kFixedSurvivor. Nothing
// is relocated if none survives. Sources and copies are at least as opaque as `min_opacity`, below
// which they would be relocated next.
Relocation plan_relocation(std::span<const float> opacity_logit,
                           std::span<const float> gradient_sum,
                           std::span<const std::uint32_t> views,
                           std::span<const std::uint32_t> survives, float min_opacity,
                           Random random);

struct RelocatedValues {
  double opacity;
  double scale;  // factor of the standard deviations
};
// Returns the values of each of n > 0 coincident copies that together render as one primitive of
// opacity `o`, in (0, 1).
RelocatedValues relocated_values(double o, int n);

// Relocates the primitives that grow() would remove; N does not change. Copies are offset as the
// clones of grow() are, because coincident ones would have equal gradients. Resets the statistics.
DensifyCounts relocate(TrainState& state, const HyperParameters& parameters,
                       const DensifyContext& context);

}  // namespace stgs::encoder
