// SPDX-License-Identifier: Apache-2.0
// Clauses 7.3 to 7.5: from planes to floats.
//
// All products of an integer and a power of two are exact in f32, and every other operation rounds
// once, so that the result does not depend on the compiler (7.5).
#include <algorithm>
#include <bit>
#include <cmath>

#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint64_t kKeyEnd = std::uint64_t{1} << 63;
constexpr std::uint32_t kMaxFloatBits = 0x71800000;  // of 2^100

// The floats of an attribute: those of primitive i begin at data[i * stride].
struct Floats {
  float* data = nullptr;
  std::size_t stride = 0;
};

Floats floats_of(std::uint16_t attribute, Gaussians4D& set) {
  const auto sh = 3 * static_cast<std::size_t>(set.sh_coefficients());
  switch (attribute) {
    case kPosition:
      return {set.position.data(), 3};
    case kTime:
      return {set.time.data(), 1};
    case kSigma:
      return {set.sigma.data(), 1};
    case kRadius:
      return {set.radius.data(), 1};
    case kVelocity:
      return {set.velocity.data(), 3};
    case kLogScale:
      return {set.log_scale.data(), 3};
    case kRotation:
      return {set.rotation.data(), 4};
    case kOpacity:
      return {set.opacity_logit.data(), 1};
    case kSh0:
      return {set.sh.data(), sh};
    case kSh1:
      return {set.sh.data() + 3, sh};
    case kSh2:
      return {set.sh.data() + 12, sh};
    default:
      return {set.sh.data() + 27, sh};
  }
}

float power(int exponent) {
  return std::ldexp(1.0f, exponent);
}

// Returns the component of a Morton key whose bit 0 is bit `shift` of it.
std::int32_t component_of(std::uint64_t key, int shift) {
  std::int32_t value = 0;
  for (int j = 0; j < 21; ++j) value |= static_cast<std::int32_t>(key >> (3 * j + shift) & 1) << j;
  return value;
}

Status out_of_range(const Stream& s) {
  return invalid_file("an integer of {} is out of range", name_of(s.attribute));
}

class StreamMapper {
 public:
  StreamMapper(const Stream& s, std::span<const Plane> planes, const MappingInput& input,
               Gaussians4D& set)
      : s_(s),
        planes_(planes),
        input_(input),
        set_(set),
        out_(floats_of(s.attribute, set)),
        key_(input.first_key) {}

  Status run() {
    if (s_.prediction == kMorton && key_ >= kKeyEnd) return out_of_range(s_);
    prepare();
    for (std::size_t i = 0; i < input_.n; ++i) {
      if (!predict(i) || !in_range() || !map(i)) return out_of_range(s_);
    }
    return {};
  }

 private:
  // Derives constants of the stream.
  void prepare() {
    step_ = power(s_.exponent);
    first_bits_ = std::bit_cast<std::uint32_t>(s_.origin[0]);
    length_ = static_cast<float>(input_.length);
    if (s_.mapping != 7) return;
    const double quotient = input_.begin / std::ldexp(double(s_.multiplier), s_.exponent);
    base_ = static_cast<std::int64_t>(std::floor(std::clamp(quotient, -0x1p25, 0x1p25)));
  }

  // Returns a value of the planes (7.3).
  std::uint64_t value(std::size_t component, std::size_t i) const {
    const std::size_t digits = s_.bits.size();
    std::uint64_t v = 0;
    int shift = 0;
    for (std::size_t d = 0; d < digits; ++d) {
      const Plane& plane = planes_[component * digits + d];
      v |= std::uint64_t{plane.data[i * plane.stride]} << shift;
      shift += s_.bits[d];
    }
    return v;
  }

  // Sets the integers of primitive i (7.4).
  bool predict(std::size_t i) {
    if (s_.prediction == kMorton) {
      const std::uint64_t v = value(0, i);
      if (v >= kKeyEnd || key_ + v >= kKeyEnd) return false;
      key_ += v;
      for (int c = 0; c < 3; ++c) q_[c] = component_of(key_, c);
      return true;
    }
    for (std::size_t c = 0; c < s_.components; ++c) {
      const auto v = static_cast<std::uint32_t>(value(c, i));
      const std::uint32_t unzigzag = v >> 1 ^ (0 - (v & 1));
      const auto last = static_cast<std::uint32_t>(q_[c]);
      q_[c] = static_cast<std::int32_t>(s_.prediction == 0   ? v
                                        : s_.prediction == 1 ? unzigzag
                                                             : last + unzigzag);
    }
    return true;
  }

  // Checks the products with the multiplier (7.5).
  bool in_range() const {
    if (s_.mapping == 0) return true;
    const std::int64_t limit = s_.mapping == 5 ? 1 << 22 : 1 << 24;
    const int count = s_.prediction == kMorton ? 3 : s_.components;
    return std::all_of(q_.begin(), q_.begin() + count, [&](std::int32_t q) {
      return std::abs(std::int64_t{q} * s_.multiplier) < limit;
    });
  }

  // Returns m * q of a component.
  std::int64_t multiple(std::size_t c) const { return std::int64_t{q_[c]} * s_.multiplier; }
  float scaled(std::int64_t multiple, float step) const {
    return step * static_cast<float>(multiple);
  }

  // Maps the integers of primitive i. Returns false if they are out of range.
  bool map(std::size_t i) {
    float* const out = out_.data + i * out_.stride;
    const auto count = static_cast<std::size_t>(components_of(s_.attribute));
    switch (s_.mapping) {
      case 0:
        for (std::size_t c = 0; c < count; ++c) out[c] = std::bit_cast<float>(q_[c]);
        return true;
      case 1:
        for (std::size_t c = 0; c < count; ++c) {
          out[c] = s_.origin[c % 3] + scaled(multiple(c), step_);
        }
        return true;
      case 2:
        return map_truncated(out);
      case 3:
        map_displacement(i, out);
        return true;
      case 5:
        for (std::size_t c = 0; c < count; c += 3) map_colour(c, out);
        return true;
      case 7:
        return map_time(out);
      default:  // 4 and 6
        return map_rotation(i, out);
    }
  }

  bool map_truncated(float* out) const {  // 7.5.3
    if (q_[0] < 0) return false;
    const std::int64_t bits = first_bits_ + (multiple(0) << s_.exponent);
    if (bits > kMaxFloatBits) return false;
    *out = std::bit_cast<float>(static_cast<std::uint32_t>(bits)) - s_.origin[1];
    return true;
  }

  void map_displacement(std::size_t i, float* out) const {  // 7.5.4
    const float length = std::min(set_.radius[i] + 2.0f * set_.sigma[i], length_);
    const int biased = static_cast<int>(std::bit_cast<std::uint32_t>(length) >> 23 & 255);
    const int exponent = std::clamp(biased - 127, -32, 32);
    const float step = power(std::clamp(s_.exponent - exponent, -100, 100));
    for (std::size_t c = 0; c < 3; ++c) out[c] = scaled(multiple(c), step);
  }

  bool map_rotation(std::size_t i, float* out) const {  // 7.5.5, 7.5.7
    int e = s_.exponent;
    if (s_.mapping == 6) {
      const float* const scales = set_.log_scale.data() + 3 * i;
      const float spread =
          std::max({scales[0], scales[1], scales[2]}) - std::min({scales[0], scales[1], scales[2]});
      e += 3;
      for (const float bound : {0.125f, 0.5f, 1.25f, 2.375f, 3.75f, 5.0f}) e -= spread >= bound;
      e = std::clamp(e, -14, -1);
    }
    const std::int64_t x = multiple(0), y = multiple(1), z = multiple(2);
    const std::int64_t r = (std::int64_t{1} << -2 * e) - x * x - y * y - z * z;
    if (r <= 0) return false;
    const float step = power(e);
    out[0] = step * std::sqrt(static_cast<float>(r));
    out[1] = scaled(x, step);
    out[2] = scaled(y, step);
    out[3] = scaled(z, step);
    return true;
  }

  void map_colour(std::size_t c, float* out) const {  // 7.5.6
    const std::int64_t y = multiple(c), o = multiple(c + 1), g = multiple(c + 2);
    out[c] = scaled(y - g + o, step_);
    out[c + 1] = scaled(y + g, step_);
    out[c + 2] = scaled(y - g - o, step_);
  }

  bool map_time(float* out) const {  // 7.5.8
    const std::int64_t sum = (q_[0] + base_) * s_.multiplier;
    if (std::abs(sum) >= 1 << 24) return false;
    *out = s_.origin[0] + scaled(sum, step_);
    return true;
  }

  const Stream& s_;
  std::span<const Plane> planes_;
  const MappingInput& input_;
  Gaussians4D& set_;
  Floats out_;
  std::uint64_t key_;                             // of the previous primitive
  std::array<std::int32_t, kMaxComponents> q_{};  // of the current primitive; before: the previous
  float step_ = 1, length_ = 0;                   // 2^e; of the part, ticks
  std::int64_t first_bits_ = 0, base_ = 0;        // bits of origin[0]; F of 7.5.8
};

// Checks the values of an attribute (6.4).
Status check_values(const Stream& s, std::size_t n, Gaussians4D& set) {
  const Floats floats = floats_of(s.attribute, set);
  const auto count = static_cast<std::size_t>(components_of(s.attribute));
  for (std::size_t i = 0; i < n; ++i) {
    const float* const v = floats.data + i * floats.stride;
    const bool is_finite = std::all_of(v, v + count, [](float x) { return std::isfinite(x); });
    const bool is_valid = s.attribute == kSigma    ? *v > 0
                          : s.attribute == kRadius ? *v >= 0
                          : s.attribute == kRotation
                              ? std::any_of(v, v + count, [](float x) { return x != 0; })
                              : true;
    if (!is_finite || !is_valid) {
      return invalid_file("{} of its primitive {} is not finite or out of range",
                          name_of(s.attribute), i);
    }
  }
  return {};
}

}  // namespace

Status map_stream(const Stream& stream, std::span<const Plane> planes, const MappingInput& input,
                  Gaussians4D& set) {
  STGS_TRY(StreamMapper(stream, planes, input, set).run());
  return check_values(stream, input.n, set);
}

}  // namespace stgs::stgs1
