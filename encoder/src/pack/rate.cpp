// SPDX-License-Identifier: Apache-2.0
#include "pack/rate.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs::encoder {
namespace {

constexpr int kRateSteps = 8;      // a unit of quality
constexpr int kTighterBounds = 4;  // attempts at an error that the first bound does not keep

void measure_positions(const Scene& scene, Packed& packed) {
  double largest = 0.0, squares = 0.0;
  std::uint64_t part_end = 0;
  std::size_t part = 0;
  for (std::size_t i = 0; i < packed.order.size(); ++i) {
    double length = scene.metadata.frames;
    if (!packed.decoded.parts.empty()) {
      while (i >= part_end) part_end += packed.decoded.parts[part++].primitives;
      const ScenePart& in = packed.decoded.parts[part - 1];
      length = in.end_ticks - in.begin_ticks;
    }
    const double error =
        trajectory_error(scene.gaussians, packed.order[i], packed.decoded.gaussians, i, length);
    largest = std::max(largest, error);
    squares += error * error;
  }
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

Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& go_on) {
  WriteSettings write = write_settings(settings, quality);
  const double bound = write.max_error;
  Packed packed;
  packed.quality = quality;
  for (int attempt = 0; attempt <= kTighterBounds; ++attempt, write.max_error *= 0.5) {
    STGS_TRY(go_on());
    packed.order.clear();
    STGS_ASSIGN(packed.bytes, encode_scene(scene, write, &packed.order));
    STGS_TRY(decode(scene, packed));
    if (bound == 0.0 || packed.position_max <= bound) return packed;
  }
  return unsupported(
      "primitives within {:g} thousandths of a scene unit are asked for, and {:.3g} is the best "
      "that positions of 21 bits reach over this scene: ask for that, or cut away what lies far "
      "out",
      settings.max_error, 1000.0 * packed.position_max);
}

}  // namespace

double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata) {
  return static_cast<double>(bytes) * 8e-3 / metadata.time_base.seconds(metadata.frames);
}

double trajectory_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
                        double part_ticks) {
  const float half = math::support_half_width(math::opacity_of(a.opacity_logit[i]), a.sigma[i],
                                              a.radius[i], math::kAlphaThreshold);
  if (half < 0.0f) return 0.0;
  const double first = std::max(0.0, double{a.time[i]} - half);
  const double last = std::min(part_ticks, double{a.time[i]} + half);
  if (first > last) return 0.0;
  double largest = 0.0;
  for (const double t : {first, last}) {  // both go straight: the difference is greatest at an end
    double squared = 0.0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double x = a.position[3 * i + c] + a.velocity[3 * i + c] * (t - a.time[i]);
      const double y = b.position[3 * j + c] + b.velocity[3 * j + c] * (t - b.time[j]);
      squared += (x - y) * (x - y);
    }
    largest = std::max(largest, squared);
  }
  return std::sqrt(largest);
}

Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& go_on) {
  if (settings.target_kbps == 0.0) return pack_at(scene, settings, settings.quality, go_on);
  // The greatest quality that fits lies in [low, high): bytes grow with it.
  int low = -1, high = 100 * kRateSteps + 1;
  double least = 0.0;
  while (high - low > 1) {
    STGS_TRY(go_on());
    const int middle = low + (high - low) / 2;
    STGS_ASSIGN(
        const std::vector<std::uint8_t> bytes,
        encode_scene(scene, write_settings(settings, static_cast<double>(middle) / kRateSteps)));
    const double kbps = kbps_of(bytes.size(), scene.metadata);
    if (middle == 0) least = kbps;
    (kbps <= settings.target_kbps ? low : high) = middle;
  }
  if (low < 0) {
    return usage_error(
        "{:g} kbit/s is too little: at quality 0{} this scene takes {:.1f}; train fewer primitives "
        "(--max-primitives)",
        settings.target_kbps, settings.max_error > 0.0 ? " within --max-error" : "", least);
  }
  return pack_at(scene, settings, static_cast<double>(low) / kRateSteps, go_on);
}

}  // namespace stgs::encoder
