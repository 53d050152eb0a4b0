// SPDX-License-Identifier: Apache-2.0
#include "pack/rate.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "stgs/format/differences.h"

namespace stgs::encoder {
namespace {

constexpr int kRateSteps = 8;      // a unit of quality
constexpr int kTighterBounds = 4;  // attempts at an error that the first bound does not keep

void measure_positions(const Scene& scene, Packed& packed) {
  double largest = 0.0, squares = 0.0;
  const Scene& decoded = packed.decoded;
  for_each_in_part(decoded, [&](std::size_t i, const TickRange& part) {
    const double error = trajectory_error(scene.gaussians, packed.order[i], decoded.gaussians, i,
                                          part.end - part.begin);
    largest = std::max(largest, error);
    squares += error * error;
  });
  packed.position_max = largest;
  packed.position_rms =
      std::sqrt(squares / std::max(1.0, static_cast<double>(packed.order.size())));
}

WriteSettings write_settings(const PackSettings& settings, double quality) {
  WriteSettings out;
  out.profile = settings.profile;
  out.quality = quality;
  out.tiers = settings.tiers;
  out.chunk_seconds = settings.chunk_seconds;
  out.max_error = settings.max_error / 1000.0;
  return out;
}

// Decoded before it is published: a file that pack leaves behind has been read once.
Status decode(const Scene& scene, Packed& packed) {
  STGS_ASSIGN(packed.decoded, read_scene(memory_source(packed.bytes, "the packed scene")));
  measure_positions(scene, packed);
  return {};
}

// At a quality, and decoded: with the first bound on steps that keeps max_error, which is less than
// that where a lifespan is rounded too. `too_far` where none does: the least error that was
// reached, scene units.
Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& go_on, std::optional<double>& too_far) {
  WriteSettings write = write_settings(settings, quality);
  const double bound = write.max_error;
  double least = HUGE_VAL;
  for (int attempt = 0; attempt <= kTighterBounds; ++attempt, write.max_error *= 0.5) {
    STGS_TRY(go_on());
    Packed packed;
    packed.quality = quality;
    STGS_ASSIGN(packed.bytes, encode_scene(scene, write, &packed.order));
    STGS_TRY(decode(scene, packed));
    if (bound == 0.0 || packed.position_max <= bound) return packed;
    least = std::min(least, packed.position_max);
  }
  too_far = least;
  return Packed{};
}

Status cannot_keep(const PackSettings& settings, double least) {
  const double digits = std::pow(10.0, std::floor(std::log10(1000.0 * least)) - 2.0);
  return unsupported(
      "primitives within {:g} thousandths of a scene unit are asked for, and {:.3g} is the best "
      "that positions of 21 bits reach over this scene: ask for that, or cut away what lies far "
      "out",
      settings.max_error, std::ceil(1000.0 * least / digits) * digits);
}

}  // namespace

double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata) {
  return static_cast<double>(bytes) * 8e-3 / metadata.time_base.seconds(metadata.frames);
}

Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& go_on) {
  std::optional<double> too_far;
  if (settings.target_kbps == 0.0) {
    STGS_ASSIGN(Packed packed, pack_at(scene, settings, settings.quality, go_on, too_far));
    if (too_far) return cannot_keep(settings, *too_far);
    return packed;
  }
  // The greatest quality that fits lies in [low, high): bytes grow with it. Where max_error cannot
  // be kept, it may be at a greater one, whose lifespans are finer.
  int low = -1, high = 100 * kRateSteps + 1;
  double least = 0.0, least_quality = 0.0;
  Packed best;
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    const double quality = static_cast<double>(middle) / kRateSteps;
    std::optional<double> not_here;
    STGS_ASSIGN(Packed packed, pack_at(scene, settings, quality, go_on, not_here));
    if (not_here) {
      too_far = std::min(*not_here, too_far.value_or(HUGE_VAL));
      low = middle;
      continue;
    }
    const double kbps = kbps_of(packed.bytes.size(), scene.metadata);
    if (kbps <= settings.target_kbps) {
      low = middle;
      best = std::move(packed);
    } else {
      high = middle;
      least = kbps;
      least_quality = quality;
    }
  }
  if (!best.bytes.empty()) return best;
  if (least == 0.0) return cannot_keep(settings, *too_far);
  return usage_error(
      "{:g} kbit/s is too little: at quality {:g}{} this scene takes {:.1f}; train fewer "
      "primitives "
      "(--max-primitives)",
      settings.target_kbps, least_quality, settings.max_error > 0.0 ? " within --max-error" : "",
      least);
}

}  // namespace stgs::encoder
