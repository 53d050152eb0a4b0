// SPDX-License-Identifier: Apache-2.0
#include "pack/rate.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "stgs/format/differences.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {
namespace {

constexpr int kRateSteps = 8;      // a unit of quality
constexpr int kTighterBounds = 4;  // attempts at an error that the first bound does not keep

// The primitive that lies farthest from where it was, at some moment.
struct Farthest {
  double error = HUGE_VAL;  // scene units
  std::size_t primitive = 0;
  math::Vec3 place{};      // at its T, as decoded
  bool by_motion = false;  // it lies where it was at its T
};

// Of decoded primitive j at its T, scene units.
double place_error(const Gaussians4D& set, std::size_t i, const Gaussians4D& decoded,
                   std::size_t j) {
  const double way = double{decoded.time[j]} - set.time[i];
  double squared = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double x = set.position[3 * i + c] + set.velocity[3 * i + c] * way;
    squared += (x - decoded.position[3 * j + c]) * (x - decoded.position[3 * j + c]);
  }
  return std::sqrt(squared);
}

void measure_positions(const Scene& scene, Packed& packed, Farthest& farthest) {
  double largest = -1.0, squares = 0.0;
  const Scene& decoded = packed.decoded;
  for_each_in_part(decoded, [&](std::size_t i, const TickRange& part) {
    const double error = trajectory_error(scene.gaussians, packed.order[i], decoded.gaussians, i,
                                          part.end - part.begin);
    if (error > largest) {
      largest = error;
      const std::size_t j = packed.order[i];
      const double place = place_error(scene.gaussians, j, decoded.gaussians, i);
      const float* x = &decoded.gaussians.position[3 * i];
      farthest = {error, j, {x[0], x[1], x[2]}, place < 0.5 * error};
    }
    squares += error * error;
  });
  packed.position_max = std::max(0.0, largest);
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
Status decode(const Scene& scene, Packed& packed, Farthest& farthest) {
  STGS_ASSIGN(packed.decoded, read_scene(memory_source(packed.bytes, "the packed scene")));
  measure_positions(scene, packed, farthest);
  return {};
}

// At a quality, and decoded: with the first bound on steps that keeps max_error, which is less than
// that where a lifespan is rounded too. `too_far` where none does: of the least error that was
// reached.
Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& go_on, std::optional<Farthest>& too_far) {
  WriteSettings write = write_settings(settings, quality);
  const double bound = write.max_error;
  Farthest least;
  for (int attempt = 0; attempt <= kTighterBounds; ++attempt, write.max_error *= 0.5) {
    STGS_TRY(go_on());
    Packed packed;
    packed.quality = quality;
    STGS_ASSIGN(packed.bytes, encode_scene(scene, write, &packed.order));
    Farthest farthest;
    STGS_TRY(decode(scene, packed, farthest));
    if (bound == 0.0 || packed.position_max <= bound) return packed;
    if (farthest.error < least.error) least = farthest;
  }
  too_far = least;
  return Packed{};
}

Status cannot_keep(const Scene& scene, const PackSettings& settings, const Farthest& least) {
  const double digits = std::pow(10.0, std::floor(std::log10(1000.0 * least.error)) - 2.0);
  const double best = std::ceil(1000.0 * least.error / digits) * digits;
  const float* u = &scene.gaussians.velocity[3 * least.primitive];
  const std::string cause =
      least.by_motion
          ? fmt::format("steps of what moves {:.3g} units a frame reach, as primitive {} does",
                        std::hypot(double{u[0]}, double{u[1]}, double{u[2]}), least.primitive)
          : fmt::format("positions of 21 bits reach, at primitive {} at ({:g}, {:g}, {:g})",
                        least.primitive, least.place.x, least.place.y, least.place.z);
  return unsupported(
      "primitives within {:g} thousandths of a scene unit are asked for, and {:.3g} is the best "
      "that {}: ask for that, or cut away what {}",
      settings.max_error, best, cause, least.by_motion ? "moves so fast" : "lies far out");
}

}  // namespace

double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata) {
  return static_cast<double>(bytes) * 8e-3 / metadata.time_base.seconds(metadata.frames);
}

Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& go_on) {
  std::optional<Farthest> too_far;
  if (settings.target_kbps == 0.0) {
    STGS_ASSIGN(Packed packed, pack_at(scene, settings, settings.quality, go_on, too_far));
    if (too_far) return cannot_keep(scene, settings, *too_far);
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
    std::optional<Farthest> not_here;
    STGS_ASSIGN(Packed packed, pack_at(scene, settings, quality, go_on, not_here));
    if (not_here) {
      if (!too_far || not_here->error < too_far->error) too_far = not_here;
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
  if (least == 0.0) return cannot_keep(scene, settings, *too_far);
  return usage_error(
      "{:g} kbit/s is too little: at quality {:g}{} this scene takes {:.1f}; train fewer "
      "primitives "
      "(--max-primitives)",
      settings.target_kbps, least_quality, settings.max_error > 0.0 ? " within --max-error" : "",
      least);
}

}  // namespace stgs::encoder
