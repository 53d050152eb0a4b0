// SPDX-License-Identifier: Apache-2.0
#include "packed_segment.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/parallel.h"

namespace stgs::player {
namespace {

using namespace math;

std::uint32_t sh_floats(int sh_degree) {
  return static_cast<std::uint32_t>(3 * (sh_degree + 1) * (sh_degree + 1));
}

std::uint32_t sh_planes(int sh_degree) {
  return (sh_floats(sh_degree) + 3) / 4;
}

// Returns the bits of the nearest half float, ties to even. Values that are not finite stay so:
// such primitives are not rendered.
std::uint32_t half_bits(float x) {
  constexpr float kMaxHalf = 65504.0f;
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const std::uint32_t sign = bits >> 16 & 0x8000u;
  if (!std::isfinite(x)) return sign | (std::isnan(x) ? 0x7E00u : 0x7C00u);
  const float magnitude = std::min(std::abs(x), kMaxHalf);
  // Adding 0.5 rounds to the precision of subnormal half floats.
  if (magnitude < 0x1p-14f) {
    return sign | (std::bit_cast<std::uint32_t>(magnitude + 0.5f) - 0x3F000000u);
  }
  const auto m = std::bit_cast<std::uint32_t>(magnitude);
  return sign | (((m + 0xFFFu + (m >> 13 & 1u)) >> 13) - (112u << 10));
}

constexpr std::size_t kBlock = 1024;  // primitives per task

struct Arrays {
  float *support, *position_time, *velocity_opacity, *lifespan, *covariance, *covariance_rest;
  std::uint32_t* sh;
};

Arrays arrays_at(std::uint8_t* memory, std::size_t n) {
  auto* at = reinterpret_cast<float*>(memory);
  const auto take = [&](std::size_t each) {
    float* const array = at;
    at += each * n;
    return array;
  };
  Arrays out{};
  out.support = take(2);
  out.position_time = take(4);
  out.velocity_opacity = take(4);
  out.lifespan = take(2);
  out.covariance = take(4);
  out.covariance_rest = take(2);
  out.sh = reinterpret_cast<std::uint32_t*>(at);
  return out;
}

void put(float* to, std::initializer_list<float> values) {
  std::copy(values.begin(), values.end(), to);
}

void pack_one(const Gaussians4D& set, std::size_t i, const Arrays& to, std::size_t k) {
  const float opacity = opacity_of(set.opacity_logit[i]), time = set.time[i];
  const Support support =
      candidate_support(opacity, time, set.sigma[i], set.radius[i], kAlphaThreshold);
  const float *x = &set.position[3 * i], *u = &set.velocity[3 * i], *s = &set.log_scale[3 * i];
  const float* q = &set.rotation[4 * i];
  const Sym3 v =
      covariance_of({q[0], q[1], q[2], q[3]}, {std::exp(s[0]), std::exp(s[1]), std::exp(s[2])});
  put(to.support + 2 * k, {support.begin, support.end});
  put(to.position_time + 4 * k, {x[0], x[1], x[2], time});
  put(to.velocity_opacity + 4 * k, {u[0], u[1], u[2], opacity});
  put(to.lifespan + 2 * k, {set.sigma[i], set.radius[i]});
  put(to.covariance + 4 * k, {v.xx, v.xy, v.xz, v.yy});
  put(to.covariance_rest + 2 * k, {v.yz, v.zz});
}

}  // namespace

std::uint32_t padded(std::uint32_t primitives) {
  return (primitives + kPackedGroup - 1) / kPackedGroup * kPackedGroup;
}

std::uint64_t packed_bytes_each(int sh_degree) {
  return 72 + 8 * std::uint64_t{sh_planes(sh_degree)};
}

std::uint64_t packed_bytes(std::uint32_t primitives, int sh_degree) {
  return padded(primitives) * packed_bytes_each(sh_degree);
}

void pack_segment(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree,
                  std::uint8_t* memory) {
  const std::size_t n = padded(count);
  const std::size_t floats = sh_floats(sh_degree), planes = sh_planes(sh_degree);
  const std::size_t available = std::min<std::size_t>(floats, sh_floats(set.sh_degree));
  const Arrays to = arrays_at(memory, n);
  parallel_blocks(std::size_t{0}, n, kBlock, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const bool is_used = k < count;
      if (is_used) {
        pack_one(set, first + k, to, k);
      } else {
        put(to.support + 2 * k, {kNever, -kNever});
      }
      const float* const sh =
          is_used ? set.sh.data() + sh_floats(set.sh_degree) * (first + k) : nullptr;
      const auto bits = [&](std::size_t number) {
        return is_used && number < available ? half_bits(sh[number]) : 0u;
      };
      for (std::size_t p = 0; p < planes; ++p) {
        std::uint32_t* const pair = to.sh + 2 * (n * p + k);
        pair[0] = bits(4 * p) | bits(4 * p + 1) << 16;
        pair[1] = bits(4 * p + 2) | bits(4 * p + 3) << 16;
      }
    }
  });
}

}  // namespace stgs::player
