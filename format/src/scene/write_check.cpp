// SPDX-License-Identifier: Apache-2.0
// The checks of a scene before it is written.
#include <algorithm>
#include <cmath>

#include "codec/draco_points.h"
#include "scene/write.h"

namespace stgs {
namespace {

constexpr float kFarthest = 0x1p99f;  // scene units

Status check_settings(const SceneMetadata& metadata, const WriteSettings& settings) {
  if (metadata.time_base.numerator == 0 || metadata.time_base.denominator == 0 ||
      metadata.frames == 0) {
    return usage_error(
        "invalid duration: a scene needs a time base and at least one frame (got {} frames of "
        "{}/{} "
        "s)",
        metadata.frames, metadata.time_base.numerator, metadata.time_base.denominator);
  }
  STGS_TRY(check_parameter(kQuality, settings.quality));
  STGS_TRY(check_parameter(kTiers, settings.tiers));
  const double ticks = metadata.time_base.ticks(settings.chunk_seconds);
  if (!std::isfinite(ticks) || ticks < 0.0 || ticks > kMaxChunk ||
      (ticks != 0.0 && ticks * 1e6 < metadata.frames)) {
    return usage_error("invalid chunk length of {} s for a timeline of {} frames",
                       settings.chunk_seconds, metadata.frames);
  }
  return {};
}

Status check_sizes(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  if (set.sh_degree < 0 || set.sh_degree > 3) {
    return usage_error("invalid SH degree (expected 0 to 3, got {})", set.sh_degree);
  }
  const std::size_t n = set.size();
  const std::size_t sh = n * 3 * static_cast<std::size_t>(set.sh_coefficients());
  const bool good = set.position.size() == 3 * n && set.log_scale.size() == 3 * n &&
                    set.rotation.size() == 4 * n && set.sh.size() == sh && set.time.size() == n &&
                    set.velocity.size() == 3 * n && set.sigma.size() == n && set.radius.size() == n;
  if (!good) return usage_error("array lengths do not match (for {} primitives)", n);
  if (!scene.importance.empty() && scene.importance.size() != n) {
    return usage_error("number of importances does not match (expected {}, got {})", n,
                       scene.importance.size());
  }
  if (set.time_origin != 0) {
    return usage_error("times must count from the beginning of their parts (got an origin of {})",
                       set.time_origin);
  }
  if (n > 0xFFFFFFFF) return usage_error("too many primitives (at most 2^32 - 1, got {})", n);
  return {};
}

Status check_quantisation(const Scene& scene) {
  if (!scene.quantisation) return {};
  if (scene.importance.empty()) return usage_error("the steps of a scene need importances");
  if (is_valid(*scene.quantisation)) return {};
  return usage_error("the steps of the scene are out of range");
}

Status check_parts(const Scene& scene) {
  std::uint64_t primitives = 0;
  for (const ScenePart& part : scene.parts) {
    primitives += part.primitives;
    TickRange displayed = part.displayed_range();
    if (!part.cut) displayed.begin = std::max(displayed.begin, 0.0);
    if (!is_valid_part({0, part.begin_ticks, part.end_ticks, displayed, 0})) {
      return usage_error(
          "invalid part (ticks {} to {}, displayed from {} to {}): ranges must be in order, not "
          "before "
          "the timeline, at most 2^32 ticks long and multiples of 2^-20 ticks",
          part.begin_ticks, part.end_ticks, displayed.begin, displayed.end);
    }
  }
  if (!scene.parts.empty() && primitives != scene.gaussians.size()) {
    return usage_error("the parts do not cover all primitives (expected {}, got {})",
                       scene.gaussians.size(), primitives);
  }
  const std::optional<CaptureWindow>& window = scene.metadata.window;
  if (window &&
      std::uint64_t{window->first_frame} + scene.metadata.frames > window->capture_frames) {
    return usage_error("window of {} frames from frame {} exceeds the capture of {} frames",
                       scene.metadata.frames, window->first_frame, window->capture_frames);
  }
  return {};
}

Status check_values(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < scene.importance.size(); ++i) {
    if (scene.importance[i] >= 0.0f && std::isfinite(scene.importance[i])) continue;
    return usage_error("invalid importance of primitive {} (expected a number >= 0, got {})", i,
                       scene.importance[i]);
  }
  for (Attribute attribute : attributes_of(set.sh_degree)) {
    const AttributeView<const float> view = view_of(set, attribute);
    const auto components = static_cast<std::size_t>(components_of(attribute));
    for (std::size_t i = 0; i < set.size(); ++i) {
      for (std::size_t c = 0; c < components; ++c) {
        const float v = view.data[i * view.stride + c];
        if (!std::isfinite(v)) {
          return usage_error("invalid {}[{}] of primitive {} (expected a finite number, got {})",
                             name_of(attribute), c, i, v);
        }
      }
    }
  }
  for (std::size_t i = 0; i < set.size(); ++i) {
    if (!(set.sigma[i] > 0.0f)) {
      return usage_error("invalid sigma of primitive {} (expected > 0, got {})", i, set.sigma[i]);
    }
    if (!(set.radius[i] >= 0.0f)) {
      return usage_error("invalid radius of primitive {} (expected >= 0, got {})", i,
                         set.radius[i]);
    }
    const float* q = set.rotation.data() + 4 * i;
    if (q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f) {
      return usage_error("invalid rotation of primitive {} (quaternion of length 0)", i);
    }
  }
  return {};
}

// Checks that the steps of a quantised profile can represent the farthest position (spec 8.5).
Status check_extent(const Gaussians4D& set) {
  for (std::size_t i = 0; i < set.position.size(); ++i) {
    if (std::abs(set.position[i]) <= kFarthest) continue;
    const float* x = set.position.data() + i / 3 * 3;
    return unsupported(
        "position ({:g}, {:g}, {:g}) exceeds the quantised range of {:g}; remove the primitive or "
        "use the lossless profile",
        x[0], x[1], x[2], kFarthest);
  }
  return {};
}

}  // namespace

Status check_profile(Profile profile) {
  if (profile == Profile::kUnknown)
    return usage_error("cannot write the profile {}", profile_name(profile));
  return profile == Profile::kDraco ? check_draco() : Status();
}

Status check_scene(const Scene& scene, const WriteSettings& settings) {
  STGS_TRY(check_profile(settings.profile));
  STGS_TRY(check_settings(scene.metadata, settings));
  STGS_TRY(check_sizes(scene));
  STGS_TRY(check_values(scene));
  STGS_TRY(check_quantisation(scene));
  if (settings.profile != Profile::kLossless) STGS_TRY(check_extent(scene.gaussians));
  return check_parts(scene);
}

}  // namespace stgs
