// SPDX-License-Identifier: Apache-2.0
#include "train/method.h"

#include <algorithm>
#include <iterator>

#include "stgs/encoder/train.h"
#include "stgs/format/math/project.h"

namespace stgs::encoder {
namespace {

struct NamedMethod {
  const char* name;
  Method method;
};
constexpr NamedMethod kMethods[] = {{"sharptimegs", Method::kSharpTimeGs},
                                    {"freetimegs", Method::kFreeTimeGs},
                                    {"4dgs", Method::k4dgs}};

constexpr double kFramesPerSecond = 30;  // assumed, because presets do not know the capture
// Both methods train for 30,000 iterations; their schedules are fractions of that.
constexpr double kPublishedIterations = 30000;

// Turns off the parts of SharpTimeGS's training that neither method has.
void apply_common(HyperParameters& p) {
  p.kernel = math::kDilated;
  p.weight_lifespan = p.weight_opacity = p.weight_scale = p.weight_normal = 0;
  p.velocity_shrink = 0;
  p.short_rate = 0;
  p.drop_share = 0;
  p.compact_share = 0;
  p.coarse_until = 0;
  p.sh_step = 1000 / kPublishedIterations;
  p.densify_from = 500 / kPublishedIterations;
  p.initial_scale_dynamic = p.initial_scale;
  p.initial_opacity_dynamic = p.initial_opacity;
}

}  // namespace

std::vector<std::string> method_names() {
  std::vector<std::string> names;
  for (const NamedMethod& named : kMethods) names.emplace_back(named.name);
  return names;
}

Result<Method> method_from_name(const std::string& name) {
  const auto* named = std::find_if(std::begin(kMethods), std::end(kMethods),
                                   [&name](const NamedMethod& n) { return name == n.name; });
  if (named == std::end(kMethods)) {
    return usage_error("--method: unknown method '{}'; use one of: {}", name,
                       fmt::join(method_names(), ", "));
  }
  return named->method;
}

void apply_method(Method method, HyperParameters& p) {
  switch (method) {
    case Method::kSharpTimeGs:
      return;
    case Method::kFreeTimeGs:
      apply_common(p);
      p.weight_opacity = 1e-2;
      p.prune_opacity = 0.02;
      p.lr_velocity = 1.6e-3 / kFramesPerSecond;
      p.lr_velocity_final = 1.6e-5 / kFramesPerSecond;
      p.densify_until = 25000 / kPublishedIterations;
      // A standard deviation of 0.1 s; sigma is sqrt(2) times that.
      p.sigma_dynamic = 0.1 * kFramesPerSecond * 1.41421356;
      p.sigma_static = 0.2;
      return;
    case Method::k4dgs:
      apply_common(p);
      p.weight_perceptual = 0;
      p.initial_opacity_dynamic = 0.2;
      return;
  }
}

Ablation ablation_of(Method method) {
  Ablation parts;
  if (method == Method::kSharpTimeGs) return parts;
  parts.lifespan = parts.modulation = false;
  parts.representation = method == Method::kFreeTimeGs;
  parts.densification =
      method == Method::kFreeTimeGs ? Densification::kRelocation : Densification::kPlain;
  return parts;
}

}  // namespace stgs::encoder
