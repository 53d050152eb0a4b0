// SPDX-License-Identifier: Apache-2.0
// The packed layout of segments, against the equations of spec/representation.md.
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "loop_math.h"
#include "packed_segment.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"

namespace stgs::player {
namespace {

constexpr float kEps = 0x1p-23f;

// The value of a finite half float.
float half_value(std::uint32_t bits) {
  const auto exponent = static_cast<int>(bits >> 10 & 31);
  const auto fraction = static_cast<float>(bits & 1023);
  const float size =
      exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024.0f + fraction, exponent - 25);
  return (bits & 0x8000) != 0 ? -size : size;
}

// Primitives of all sizes and opacities, some of which are never visible.
Gaussians4D make_set(std::size_t n, int sh_degree) {
  Gaussians4D set = testing::random_scene(n, sh_degree, 60, 7).gaussians;
  for (std::size_t i = 0; i < n; ++i) {
    set.opacity_logit[i] = -8.0f + 0.37f * static_cast<float>(i % 50);
    for (std::size_t c = 0; c < 3; ++c)
      set.log_scale[3 * i + c] = -12.0f + 0.31f * static_cast<float>((i + 7 * c) % 45);
  }
  return set;
}

struct Packed {
  std::size_t n;
  std::vector<float> floats;  // of the arrays before the SH
  std::vector<std::uint16_t> halves;

  // Value c of entry k of the array that begins after `before` values per entry.
  float at(std::size_t before, std::size_t width, std::size_t k, std::size_t c) const {
    return floats[before * n + width * k + c];
  }
  std::uint16_t sh(std::size_t k, std::size_t number) const {
    return halves[4 * (n * (number / 4) + k) + number % 4];
  }
};

// Packs into memory that is not 0.
Packed pack(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree) {
  std::vector<std::uint8_t> memory(packed_bytes(count, sh_degree), 0xCD);
  pack_segment(set, first, count, sh_degree, memory.data());
  Packed out{padded(count), {}, {}};
  out.floats.resize(18 * out.n);
  std::memcpy(out.floats.data(), memory.data(), 4 * out.floats.size());
  out.halves.resize((memory.size() - 4 * out.floats.size()) / 2);
  std::memcpy(out.halves.data(), memory.data() + 4 * out.floats.size(), 2 * out.halves.size());
  return out;
}

void check_support(const Gaussians4D& set, std::size_t i, const Packed& packed, std::size_t k) {
  const float o = set.opacity_logit[i], opacity = math::opacity_of(o);
  const math::Support s = math::candidate_support(opacity, set.time[i], set.sigma[i], set.radius[i],
                                                  math::kAlphaThreshold);
  if (std::abs(opacity / math::kAlphaThreshold - 1.0f) < 1e-4f) return;  // either is right
  const float tolerance = 1e-5f * (1.0f + std::abs(s.begin) + std::abs(s.end));
  CHECK(packed.at(0, 2, k, 0) == Approx(s.begin).margin(s.begin > s.end ? 0.0f : tolerance));
  CHECK(packed.at(0, 2, k, 1) == Approx(s.end).margin(s.begin > s.end ? 0.0f : tolerance));
  CHECK(packed.at(6, 4, k, 3) == Approx(opacity).margin(8 * kEps));
}

void check_covariance(const Gaussians4D& set, std::size_t i, const Packed& packed, std::size_t k) {
  const float *q = &set.rotation[4 * i], *s = &set.log_scale[3 * i];
  const math::Sym3 v = math::covariance_of({q[0], q[1], q[2], q[3]},
                                           {std::exp(s[0]), std::exp(s[1]), std::exp(s[2])});
  const float tolerance = 32 * kEps * (v.xx + v.yy + v.zz);
  const float expected[] = {v.xx, v.xy, v.xz, v.yy, v.yz, v.zz};
  for (std::size_t c = 0; c < 6; ++c) {
    const float found = c < 4 ? packed.at(12, 4, k, c) : packed.at(16, 2, k, c - 4);
    if (!(std::abs(found - expected[c]) <= tolerance)) FAIL(found << " instead of " << expected[c]);
  }
}

void check_copies(const Gaussians4D& set, std::size_t i, const Packed& packed, std::size_t k) {
  for (std::size_t c = 0; c < 3; ++c) {
    CHECK(packed.at(2, 4, k, c) == set.position[3 * i + c]);
    CHECK(packed.at(6, 4, k, c) == set.velocity[3 * i + c]);
  }
  CHECK(packed.at(2, 4, k, 3) == set.time[i]);
  CHECK(packed.at(10, 2, k, 0) == set.sigma[i]);
  CHECK(packed.at(10, 2, k, 1) == set.radius[i]);
}

// Compares primitives [first, first + count), packed for a degree.
void check(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree) {
  INFO("degree " << set.sh_degree << " packed as " << sh_degree);
  const Packed packed = pack(set, first, count, sh_degree);
  const auto own = static_cast<std::size_t>(3 * set.sh_coefficients());
  const auto numbers = static_cast<std::size_t>(3 * (sh_degree + 1) * (sh_degree + 1));
  const std::size_t places = (numbers + 3) / 4 * 4;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = first + k;
    check_support(set, i, packed, k);
    check_covariance(set, i, packed, k);
    check_copies(set, i, packed, k);
    for (std::size_t number = 0; number < places; ++number) {
      const bool is_set = number < std::min(own, numbers);
      const float expected = is_set ? set.sh[own * i + number] : 0.0f;
      const float found = half_value(packed.sh(k, number));
      if (!(std::abs(found - expected) <= std::abs(expected) * 0x1p-11f + 0x1p-25f))
        FAIL("sh " << number << " of " << i << ": " << found << " instead of " << expected);
    }
  }
  for (std::size_t k = count; k < packed.n; ++k)
    CHECK(packed.at(0, 2, k, 0) > packed.at(0, 2, k, 1));
}

}  // namespace

TEST_CASE("packed segments contain the values of the equations") {
  for (int degree = 0; degree <= 3; ++degree) {
    const Gaussians4D set = make_set(1700, degree);
    check(set, 0, 1700, degree);
    check(set, 130, 65, degree);
    check(set, 1699, 1, degree);
    check(set, 3, 300, 3);
    check(set, 0, 70, 0);
  }
}

TEST_CASE("half floats are the nearest ones, ties to even") {
  for (std::uint32_t bits = 0; bits < 0x7BFF; ++bits) {  // the last one has no next one
    const float value = half_value(bits), next = half_value(bits + 1);
    const float tie = value + (next - value) / 2;
    const std::uint32_t even = bits % 2 == 0 ? bits : bits + 1;
    const bool good = half_bits(value) == bits && half_bits(-value) == (bits | 0x8000) &&
                      half_bits(tie) == even && half_bits(std::nextafter(tie, 0.0f)) == bits &&
                      half_bits(std::nextafter(tie, next)) == bits + 1;
    if (!good) FAIL("around " << value);
  }
}

TEST_CASE("half floats clamp large values, and keep values that are not finite") {
  const float infinity = std::numeric_limits<float>::infinity();
  CHECK(half_bits(65519.0f) == 0x7BFF);
  CHECK(half_bits(1e38f) == 0x7BFF);
  CHECK(half_bits(-1e38f) == 0xFBFF);
  CHECK(half_bits(infinity) == 0x7C00);
  CHECK(half_bits(-infinity) == 0xFC00);
  CHECK((half_bits(std::numeric_limits<float>::quiet_NaN()) & 0x7FFF) == 0x7E00);
}

TEST_CASE("primitives that are not finite stay so") {
  CHECK(std::isnan(exp_of(std::numeric_limits<float>::quiet_NaN())));
  Gaussians4D set = make_set(3, 0);
  set.log_scale[3] = 100.0f;
  const Packed packed = pack(set, 0, 3, 0);
  CHECK(std::isfinite(packed.at(12, 4, 0, 0)));
  CHECK_FALSE(std::isfinite(packed.at(12, 4, 1, 0)));
}

}  // namespace stgs::player
