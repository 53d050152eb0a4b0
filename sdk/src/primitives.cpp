// SPDX-License-Identifier: Apache-2.0
// Primitives at one time, for applications that render or measure them on their own.
#include <algorithm>
#include <cmath>
#include <limits>

#include "scene.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "structs.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

stgs_primitives default_primitives() {
  stgs_primitives primitives{};
  primitives.struct_size = sizeof(primitives);
  return primitives;
}

// Returns the nearest finite value. Files state finite values, whose products can be infinite.
float in_range(float v) {
  constexpr float kGreatest = std::numeric_limits<float>::max();
  return std::clamp(v, -kGreatest, kGreatest);
}

// Writes primitives one after another, up to the capacity, and counts all of them.
class Writer {
 public:
  Writer(const stgs_primitives& to, int sh_degree, double ticks_per_second)
      : to_(to),
        sh_floats_(static_cast<std::size_t>(3 * (sh_degree + 1) * (sh_degree + 1))),
        ticks_per_second_(static_cast<float>(ticks_per_second)) {}

  std::uint64_t count() const { return count_; }

  // `age` is the time relative to the centre of the lifespan, ticks.
  void add(const stgs::Gaussians4D& set, std::size_t i, std::uint32_t id, float age,
           float opacity) {
    const std::size_t at = count_++;
    if (at >= to_.capacity) return;
    if (to_.id != nullptr) to_.id[at] = id;
    if (to_.opacity != nullptr) to_.opacity[at] = opacity;
    for (std::size_t c = 0; c < 3; ++c) {
      const float velocity = set.velocity[3 * i + c];
      if (to_.position != nullptr)
        to_.position[3 * at + c] = in_range(set.position[3 * i + c] + velocity * age);
      if (to_.velocity != nullptr)
        to_.velocity[3 * at + c] = in_range(velocity * ticks_per_second_);
      if (to_.scale != nullptr)
        to_.scale[3 * at + c] = in_range(std::exp(set.log_scale[3 * i + c]));
    }
    if (to_.rotation != nullptr) add_rotation(&set.rotation[4 * i], to_.rotation + 4 * at);
    if (to_.sh != nullptr) add_sh(set, i, to_.sh + sh_floats_ * at);
  }

 private:
  static void add_rotation(const float* q, float* out) {
    // In double: the quaternion may have any non-zero length.
    const double length = std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] +
                                    double{q[2]} * q[2] + double{q[3]} * q[3]);
    for (int c = 0; c < 4; ++c) out[c] = static_cast<float>(q[c] / length);
  }

  // A set whose SH data is incomplete has fewer coefficients than the file; the rest is 0.
  void add_sh(const stgs::Gaussians4D& set, std::size_t i, float* out) const {
    const auto floats = static_cast<std::size_t>(3 * set.sh_coefficients());
    const std::size_t available = std::min(floats, sh_floats_);
    std::copy_n(set.sh.begin() + static_cast<std::ptrdiff_t>(floats * i), available, out);
    std::fill(out + available, out + sh_floats_, 0.0f);
  }

  const stgs_primitives& to_;
  std::size_t sh_floats_;
  float ticks_per_second_;
  std::uint64_t count_ = 0;
};

void add_visible(const stgs::player::Timeline::Active::Segment& segment, Writer& writer) {
  const stgs::Gaussians4D& set = *segment.set;
  for (const std::uint32_t i : *segment.candidates) {
    const auto age = static_cast<float>(segment.ticks - set.time[i]);
    const float opacity = stgs::math::opacity_of(set.opacity_logit[i]) *
                          stgs::math::visibility(age, set.sigma[i], set.radius[i]);
    if (opacity < stgs::math::kAlphaThreshold) continue;
    writer.add(set, i, segment.id_base + i, age, opacity);
  }
}

}  // namespace

extern "C" {

stgs_result stgs_primitives_defaults(stgs_primitives* primitives, size_t struct_size) {
  return stgs::sdk::fill_defaults(primitives, struct_size, default_primitives());
}

stgs_result stgs_scene_get_primitives(stgs_scene* scene, double seconds,
                                      const stgs_primitives* primitives, uint64_t* count) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    stgs_primitives requested = default_primitives();
    if (primitives != nullptr) {
      STGS_SDK_TRY(stgs::sdk::copy_in(primitives, requested, "primitives"));
    }
    if (count == nullptr) return {STGS_ERROR_ARGUMENT, "count is NULL"};
    STGS_SDK_TRY(scene->clamp_time(seconds));
    STGS_SDK_TRY(scene->check_memory(seconds));
    stgs::player::Timeline& timeline = *scene->timeline;
    const auto active = timeline.at(seconds);
    scene->log_new_damage();
    if (!active.ok()) return active.status();
    Writer writer(requested, timeline.reader().sh_degree(),
                  1.0 / timeline.metadata().time_base.seconds(1.0));
    for (const auto& segment : active->segments) add_visible(segment, writer);
    *count = writer.count();
    return {};
  });
}

}  // extern "C"
