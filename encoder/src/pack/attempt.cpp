// SPDX-License-Identifier: Apache-2.0
#include "pack/attempt.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "stgs/format/coded_segment.h"
#include "stgs/format/differences.h"

namespace stgs::encoder {
namespace {

constexpr int kMaxTightenings = 4;  // of the bound, if the first does not meet max_error

// Returns the position error of decoded primitive j at its T, scene units.
double position_error(const Gaussians4D& set, std::size_t i, const Gaussians4D& decoded,
                      std::size_t j) {
  const double dt = double{decoded.time[j]} - set.time[i];
  double squared = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double x = set.position[3 * i + c] + set.velocity[3 * i + c] * dt;
    squared += (x - decoded.position[3 * j + c]) * (x - decoded.position[3 * j + c]);
  }
  return std::sqrt(squared);
}

void measure_positions(const Scene& scene, Packed& packed, WorstPrimitive& worst) {
  double max_error = -1.0, squares = 0.0;
  const Scene& decoded = packed.decoded;
  for_each_in_part(decoded, [&](std::size_t i, const TickRange& part) {
    const double error = trajectory_error(scene.gaussians, packed.order[i], decoded.gaussians, i,
                                          part.end - part.begin);
    if (error > max_error) {
      max_error = error;
      const std::size_t j = packed.order[i];
      const double at_own_time = position_error(scene.gaussians, j, decoded.gaussians, i);
      const float* x = &decoded.gaussians.position[3 * i];
      worst = {error, j, {x[0], x[1], x[2]}, at_own_time < 0.5 * error};
    }
    squares += error * error;
  });
  packed.position_max = std::max(0.0, max_error);
  packed.position_rms =
      std::sqrt(squares / std::max(1.0, static_cast<double>(packed.order.size())));
}

WriteSettings write_settings(const PackSettings& settings, double quality) {
  WriteSettings out;
  out.profile = settings.profile;
  // Other tiers or a bound need other steps.
  out.own_steps = quality == 0 && settings.max_error == 0 && settings.tiers == 0;
  if (quality > 0) out.quality = quality;
  out.tiers = settings.tiers;
  out.chunk_seconds = settings.chunk_seconds;
  out.max_error = settings.max_error / 1000.0;
  return out;
}

// Decodes the packed bytes, so that every file that pack writes has been read once.
Status decode(const Scene& scene, Packed& packed, WorstPrimitive& worst) {
  STGS_ASSIGN(packed.decoded, read_scene(memory_source(packed.bytes, "the packed scene")));
  measure_positions(scene, packed, worst);
  return {};
}

// Encodes a scene for settings that have been checked: what is invalid then comes from the input.
Status encode(const Scene& scene, const WriteSettings& settings, Packed& packed) {
  Result<std::vector<std::uint8_t>> bytes = encode_scene(scene, settings, &packed.order);
  if (bytes.status().code() == StatusCode::kUsage) {
    return invalid_file("cannot be packed: {}", bytes.status().message());
  }
  STGS_TRY(bytes.status());
  packed.bytes = std::move(bytes).value();
  return {};
}

}  // namespace

Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& before_attempt,
                       std::optional<WorstPrimitive>& too_far) {
  WriteSettings write = write_settings(settings, quality);
  const double bound = write.max_error;
  WorstPrimitive best;
  for (int attempt = 0; attempt <= kMaxTightenings; ++attempt, write.max_error *= 0.5) {
    STGS_TRY(before_attempt());
    Packed packed;
    if (settings.profile != Profile::kNearLossless)
      packed.quality =
          write.own_steps && scene.quantisation ? scene.quantisation->quality : write.quality;
    STGS_TRY(encode(scene, write, packed));
    WorstPrimitive worst;
    STGS_TRY(decode(scene, packed, worst));
    if (bound == 0.0 || packed.position_max <= bound) return packed;
    if (worst.error < best.error) best = worst;
  }
  too_far = best;
  return Packed{};
}

Status unreachable_error(const Scene& scene, const PackSettings& settings,
                         const WorstPrimitive& worst) {
  const double digits = std::pow(10.0, std::floor(std::log10(1000.0 * worst.error)) - 2.0);
  const double best = std::ceil(1000.0 * worst.error / digits) * digits;
  const float* u = &scene.gaussians.velocity[3 * worst.primitive];
  const std::string cause =
      worst.by_motion
          ? fmt::format("because primitive {} moves by {:.3g} units per frame", worst.primitive,
                        std::hypot(double{u[0]}, double{u[1]}, double{u[2]}))
          : fmt::format("because primitive {} is at ({:g}, {:g}, {:g}) and positions have {} bits",
                        worst.primitive, worst.position.x, worst.position.y, worst.position.z,
                        position_bits(settings.profile == Profile::kNearLossless));
  return unsupported(
      "--max-error {:g} cannot be met: the smallest possible error is {:.3g} thousandths of a "
      "scene "
      "unit, {}; allow that error, or remove the primitives that {}",
      settings.max_error, best, cause, worst.by_motion ? "move so fast" : "are so far out");
}

}  // namespace stgs::encoder
