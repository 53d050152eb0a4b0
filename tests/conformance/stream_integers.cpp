// SPDX-License-Identifier: Apache-2.0
#include "stream_integers.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace stgs::testing {
namespace {

using Values = std::vector<std::uint32_t>;

std::int64_t signed_of(std::uint32_t v) {
  return static_cast<std::int32_t>(v);
}

std::uint32_t bits_of(float v) {
  return std::bit_cast<std::uint32_t>(v);
}

// Reads the values of one component from `digits` planes (spec 8.1).
Values values_of(const Plane* planes, const std::vector<int>& digit_bits, std::size_t n) {
  Values out(n);
  int shift = 0;
  for (std::size_t d = 0; d < digit_bits.size(); shift += digit_bits[d++]) {
    for (std::size_t i = 0; shift < 32 && i < n; ++i) {
      const std::uint32_t symbol = planes[d].symbols ? planes[d].symbols[i] : planes[d].only;
      out[i] |= symbol << shift;
    }
  }
  return out;
}

void add_plain(const StreamRow& row, const Values& values, StreamIntegers& out) {
  std::vector<std::int64_t>& q = out.q.emplace_back();
  std::uint32_t sum = 0;
  for (const std::uint32_t v : values) {
    const std::int64_t difference =
        v % 2 == 0 ? std::int64_t{v / 2} : -(std::int64_t{v} + 1) / 2;  // spec 8.2
    sum += static_cast<std::uint32_t>(difference);
    switch (static_cast<Prediction>(row.prediction)) {
      case Prediction::kZigzag:
        q.push_back(difference);
        break;
      case Prediction::kDelta:
        q.push_back(signed_of(sum));
        break;
      default:
        q.push_back(signed_of(v));
    }
  }
}

void add_morton(const StreamRow& row, const std::vector<Values>& values, std::uint32_t key,
                StreamIntegers& out) {
  out.q.resize(3);
  for (std::size_t i = 0; i < values[0].size(); ++i) {
    key += values[0][i];
    for (std::size_t c = 0; c < 3; ++c) {
      std::int64_t high = 0;
      for (int j = 0; j < 10; ++j)
        high |= std::int64_t{key >> (3 * j + static_cast<int>(c)) & 1} << j;
      out.q[c].push_back((high << row.low) + (row.low > 0 ? values[1 + c][i] : 0));
    }
  }
}

// Sets the integers after prediction (spec 8.3, 8.4).
void add_integers(const StreamRow& row, const Plane* planes, std::size_t n, std::uint32_t key,
                  StreamIntegers& out) {
  const std::vector<int> bits(row.digit_bits.begin(), row.digit_bits.begin() + row.digits);
  if (static_cast<Prediction>(row.prediction) != Prediction::kMorton) {
    for (std::size_t c = 0; c < row.components; ++c)
      add_plain(row, values_of(planes + c * row.digits, bits, n), out);
    return;
  }
  std::vector<Values> values = {values_of(planes, bits, n)};
  const std::vector<int> low_bits(row.low_digits(), 8);
  for (std::size_t c = 0; c < 3; ++c)
    values.push_back(values_of(planes + row.digits + c * row.low_digits(), low_bits, n));
  add_morton(row, values, key, out);
}

// Returns the bits b of sigma or radius (spec 8.5, 8.6).
std::uint32_t lifespan_bits(const StreamIntegers& stream, std::size_t i) {
  const StreamRow& row = *stream.row;
  if (static_cast<Mapping>(row.mapping) == Mapping::kFloat)
    return static_cast<std::uint32_t>(stream.q[0][i]) & 0x7FFFFFFF;
  return bits_of(row.origin[0]) +
         static_cast<std::uint32_t>(stream.q[0][i] * row.step.multiplier << row.step.exponent);
}

// Returns E (spec 8.6).
int lifespan(const RecordIntegers& before, std::int64_t part_units, std::size_t i) {
  const auto exponent = [&](Attribute attribute) {
    return static_cast<int>(lifespan_bits(before.at(attribute), i) >> 23) - 127;
  };
  const int longest = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(part_units))) - 21;
  const int longer = std::max(exponent(Attribute::kSigma) + 1, exponent(Attribute::kRadius));
  return std::clamp(std::min(longer, longest), -32, 32);
}

// Returns s (spec 8.8).
int shape(const StreamIntegers& log_scale, std::size_t i) {
  const auto& q = log_scale.q;
  const auto [least, greatest] = std::minmax({q[0][i], q[1][i], q[2][i]});
  const Step step = log_scale.row->step;
  const double size = std::ldexp(static_cast<double>(greatest - least) * step.multiplier,
                                 step.exponent + 3);  // exact
  int out = 3;
  for (const double bound : {1, 4, 10, 19, 30, 40}) out -= size >= bound ? 1 : 0;
  return out;
}

// Returns floor(start / (m 2^e)) in decimal, with start in units of 2^-21 (spec 8.9).
std::string quotient(std::int64_t start, Step step) {
  const int shift = -21 - step.exponent;  // floor(start * 2^shift / m)
  std::vector<std::uint64_t> limbs(8);    // of 32 bits, the highest first
  const auto low = static_cast<std::uint64_t>(start) >> (shift < 0 ? std::min(-shift, 63) : 0);
  for (int bit = 0; bit < 63; ++bit) {
    if ((low >> bit & 1) == 0) continue;
    const int at = bit + std::max(shift, 0);
    limbs[7 - static_cast<std::size_t>(at) / 32] |= std::uint64_t{1} << at % 32;
  }
  const auto divide = [&limbs](std::uint64_t by) {
    std::uint64_t rest = 0;
    for (std::uint64_t& limb : limbs) {
      const std::uint64_t all = rest << 32 | limb;
      limb = all / by, rest = all % by;
    }
    return rest;
  };
  divide(static_cast<std::uint64_t>(step.multiplier));
  std::string out;
  do {
    out.insert(out.begin(), static_cast<char>('0' + divide(10)));
  } while (std::any_of(limbs.begin(), limbs.end(), [](std::uint64_t limb) { return limb != 0; }));
  return out;
}

// Returns step F (spec 8.9).
double time_offset(std::int64_t start, Step step) {
  const double begin = std::ldexp(static_cast<double>(start), -21);
  return begin - std::fmod(begin, std::ldexp(step.multiplier, step.exponent));
}

void add_rotations(int fixed, StreamIntegers& out) {
  const auto& q = out.q;
  const std::int64_t m = out.row->step.multiplier;
  out.numbers.assign(4, {});
  for (std::size_t i = 0; i < q[0].size(); ++i) {
    const int e = out.exponents.empty() ? fixed : out.exponents[i];
    std::int64_t rest = std::int64_t{1} << -2 * e;
    for (std::size_t c = 0; c < 3; ++c) rest -= m * q[c][i] * m * q[c][i];
    out.numbers[0].push_back(std::ldexp(std::sqrt(static_cast<double>(rest)), e));
    for (std::size_t c = 0; c < 3; ++c)
      out.numbers[c + 1].push_back(std::ldexp(static_cast<double>(m * q[c][i]), e));
  }
}

double colour(const StreamIntegers& stream, std::size_t c, std::size_t i) {
  const std::size_t first = c / 3 * 3;
  const std::int64_t y = stream.q[first][i], o = stream.q[first + 1][i], g = stream.q[first + 2][i];
  const std::int64_t sums[3] = {y - g + o, y + g, y - g - o};
  return static_cast<double>(sums[c % 3]);
}

// Returns the number of component c of value i (spec 8.5); not of rotations.
double number(const StreamIntegers& stream, std::size_t c, std::size_t i, std::int64_t start) {
  const StreamRow& row = *stream.row;
  const auto q = static_cast<double>(stream.q[c][i]);
  const double step = std::ldexp(row.step.multiplier, row.step.exponent);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      return std::bit_cast<float>(static_cast<std::uint32_t>(stream.q[c][i]));
    case Mapping::kLinear:
      return row.origin[c % 3] + step * q;
    case Mapping::kTruncated:
      return double{std::bit_cast<float>(lifespan_bits(stream, i))} - row.origin[1];
    case Mapping::kDisplacement:
      return std::ldexp(row.step.multiplier * q, stream.exponents[i]);
    case Mapping::kColour:
      return step * colour(stream, c, i);
    case Mapping::kTime:
      return row.origin[0] + (step * q + time_offset(start, row.step));
    default:
      return q;
  }
}

}  // namespace

StreamIntegers integers_of(const StreamRow& row, const Plane* planes, std::size_t n,
                           const SegmentNumbers& segment, const RecordIntegers& before) {
  StreamIntegers out;
  out.row = &row;
  add_integers(row, planes, n, segment.first_key, out);
  const auto mapping = static_cast<Mapping>(row.mapping);
  if (mapping == Mapping::kFloat) {
    for (auto& component : out.q) {
      for (std::int64_t& v : component) v = static_cast<std::uint32_t>(v) << row.step.exponent;
    }
  }
  if (mapping == Mapping::kTime) out.first = quotient(segment.start_units, row.step);
  for (std::size_t i = 0; i < n; ++i) {
    if (mapping == Mapping::kDisplacement) {
      const int life = lifespan(before, segment.part_units, i);
      out.exponents.push_back(std::clamp(row.step.exponent - life, -100, 100));
    } else if (mapping == Mapping::kShapedRotation) {
      const int shift = shape(before.at(Attribute::kLogScale), i);
      out.exponents.push_back(std::clamp(row.step.exponent + shift, -14, -1));
    }
  }
  if (mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation) {
    add_rotations(row.step.exponent, out);
    return out;
  }
  for (std::size_t c = 0; c < out.q.size(); ++c) {
    auto& numbers = out.numbers.emplace_back();
    for (std::size_t i = 0; i < n; ++i) numbers.push_back(number(out, c, i, segment.start_units));
  }
  return out;
}

}  // namespace stgs::testing
