// SPDX-License-Identifier: Apache-2.0
#include "packed_segment.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>

#include "loop_math.h"
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

constexpr std::size_t kBlock = 1024;  // primitives per task

struct Arrays {
  float *support, *position_time, *velocity_opacity, *lifespan, *covariance, *covariance_rest;
  std::uint64_t* sh;  // four half floats each
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
  out.sh = reinterpret_cast<std::uint64_t*>(at);
  return out;
}

constexpr std::size_t kRun = 64;  // primitives packed at a time; their data fit the cache
using Run = float[kRun];

// Copies component `at` of `count` rows of kWidth floats.
template <std::size_t kWidth>
void take_component(const float* rows, std::size_t at, std::size_t count, Run& out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = rows[kWidth * i + at];
}

// Fills `out` with the components xx, xy, xz, yy, yz, zz of the covariances of primitives
// [first, first + count).
void covariances(const Gaussians4D& set, std::size_t first, std::size_t count, Run (&out)[6]) {
  Run q[4], s[3];
  for (std::size_t c = 0; c < 4; ++c)
    take_component<4>(set.rotation.data() + 4 * first, c, count, q[c]);
  for (std::size_t c = 0; c < 3; ++c)
    take_component<3>(set.log_scale.data() + 3 * first, c, count, s[c]);
  for (std::size_t i = 0; i < count; ++i) {
    const Sym3 v = covariance_of({q[0][i], q[1][i], q[2][i], q[3][i]},
                                 {exp_of(s[0][i]), exp_of(s[1][i]), exp_of(s[2][i])});
    out[0][i] = v.xx, out[1][i] = v.xy, out[2][i] = v.xz;
    out[3][i] = v.yy, out[4][i] = v.yz, out[5][i] = v.zz;
  }
}

// Opacities, and supports as returned by math::candidate_support().
struct Times {
  Run opacity, begin, end;
};

void times_of(const Gaussians4D& set, std::size_t first, std::size_t count, Times& out) {
  const float *const logit = set.opacity_logit.data() + first, *const time =
                                                                   set.time.data() + first;
  const float *const sigma = set.sigma.data() + first, *const radius = set.radius.data() + first;
  for (std::size_t i = 0; i < count; ++i) {
    const float opacity = 1.0f / (1.0f + exp_of(-logit[i]));
    const float share = (opacity + 1e-5f * kAlphaThreshold) / kAlphaThreshold;
    const float half_width = radius[i] + sigma[i] * std::sqrt(larger(0.0f, log_of(share)));
    const float margin = 1e-5f * (std::abs(time[i]) + half_width) + 1e-5f;
    const bool is_seen = share >= 1.0f;
    out.opacity[i] = opacity;
    out.begin[i] = is_seen ? time[i] - half_width - margin : kNever;
    out.end[i] = is_seen ? time[i] + half_width + margin : -kNever;
  }
}

void put(float* to, std::initializer_list<float> values) {
  std::copy(values.begin(), values.end(), to);
}

// Packs everything but spherical harmonics of primitives [first, first + count) to entries from k
// on.
void pack_run(const Gaussians4D& set, std::size_t first, std::size_t count, const Arrays& to,
              std::size_t k) {
  Times times;
  Run v[6];
  times_of(set, first, count, times);
  covariances(set, first, count, v);
  for (std::size_t i = 0; i < count; ++i, ++k) {
    const std::size_t one = first + i;
    const float *const x = &set.position[3 * one], *const u = &set.velocity[3 * one];
    put(to.support + 2 * k, {times.begin[i], times.end[i]});
    put(to.position_time + 4 * k, {x[0], x[1], x[2], set.time[one]});
    put(to.velocity_opacity + 4 * k, {u[0], u[1], u[2], times.opacity[i]});
    put(to.lifespan + 2 * k, {set.sigma[one], set.radius[one]});
    put(to.covariance + 4 * k, {v[0][i], v[1][i], v[2][i], v[3][i]});
    put(to.covariance_rest + 2 * k, {v[4][i], v[5][i]});
  }
}

constexpr std::size_t kMaxShFloats = 48;

// Packs the spherical harmonics of primitives [first, first + count) to entries from k on of planes
// of n entries.
void pack_sh(const Gaussians4D& set, std::size_t first, std::size_t count, int sh_degree,
             std::size_t n, std::uint64_t* to, std::size_t k) {
  const std::size_t width = sh_floats(set.sh_degree);
  const std::size_t floats = std::min<std::size_t>(width, sh_floats(sh_degree));
  std::uint16_t halves[kRun * kMaxShFloats + 4];  // 4: those beyond the last one are loaded, too
  const float* const from = set.sh.data() + width * first;
  for (std::size_t i = 0; i < width * count; ++i) halves[i] = half_bits(from[i]);
  std::fill_n(halves + width * count, 4, std::uint16_t{0});
  for (std::size_t p = 0; p < sh_planes(sh_degree); ++p) {
    std::uint64_t* const plane = to + n * p + k;
    const std::size_t available = std::min<std::size_t>(4, floats - std::min(floats, 4 * p));
    if (available == 0) {
      std::fill_n(plane, count, std::uint64_t{0});
      continue;
    }
    const std::uint64_t used = ~std::uint64_t{0} >> (64 - 16 * available);
    for (std::size_t i = 0; i < count; ++i) {
      std::uint64_t four = 0;
      std::memcpy(&four, halves + width * i + 4 * p, sizeof four);
      plane[i] = four & used;
    }
  }
}

// Makes entries [begin, end) of arrays of n primitives that are never active.
void pad(const Arrays& to, std::size_t begin, std::size_t end, std::size_t planes, std::size_t n) {
  const auto clear = [&](float* array, std::size_t width) {
    std::fill(array + width * begin, array + width * end, 0.0f);
  };
  for (std::size_t k = begin; k < end; ++k) put(to.support + 2 * k, {kNever, -kNever});
  for (float* const array : {to.position_time, to.velocity_opacity, to.covariance}) clear(array, 4);
  for (float* const array : {to.lifespan, to.covariance_rest}) clear(array, 2);
  for (std::size_t p = 0; p < planes; ++p)
    std::fill(to.sh + n * p + begin, to.sh + n * p + end, std::uint64_t{0});
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

std::vector<std::uint32_t> packed_widths(int sh_degree) {
  std::vector<std::uint32_t> out{8, 16, 16, 8, 16, 8};
  out.insert(out.end(), sh_planes(sh_degree), 8);
  return out;
}

void pack_segment(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree,
                  std::uint8_t* memory) {
  const std::size_t n = padded(count);
  const Arrays to = arrays_at(memory, n);
  const auto pack = [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; k += kRun) {
      const std::size_t used = std::min(kRun, end - k);
      pack_run(set, first + k, used, to, k);
      pack_sh(set, first + k, used, sh_degree, n, to.sh, k);
    }
  };
  parallel_blocks(std::size_t{0}, std::size_t{count}, kBlock, pack);
  pad(to, count, n, sh_planes(sh_degree), n);
}

}  // namespace stgs::player
