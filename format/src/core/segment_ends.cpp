// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/segment_ends.h"

#include <algorithm>

#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

void move_position(std::size_t i, float dt, Gaussians4D& set) {
  float* const x = &set.position[3 * i];
  const float* const u = &set.velocity[3 * i];
  const math::Vec3 moved = math::position_at({x[0], x[1], x[2]}, {u[0], u[1], u[2]}, dt);
  x[0] = moved.x;
  x[1] = moved.y;
  x[2] = moved.z;
}

}  // namespace

void apply_ends(std::span<const SegmentEnd> ends, std::size_t first, Gaussians4D& set) {
  const auto begin = static_cast<float>(-set.time_origin);
  auto end = std::lower_bound(
      ends.begin(), ends.end(), first,
      [](const SegmentEnd& one, std::size_t primitive) { return one.primitive < primitive; });
  for (; end != ends.end() && end->primitive - first < set.time.size(); ++end) {
    const std::size_t i = end->primitive - first;
    const float before = set.time[i];
    const math::Lifespan ended = math::ended_lifespan(
        before, set.radius[i], begin, static_cast<float>(end->ticks - set.time_origin));
    set.time[i] = ended.time;
    set.radius[i] = ended.radius;
    if (!set.position.empty()) move_position(i, ended.time - before, set);
  }
}

}  // namespace stgs
