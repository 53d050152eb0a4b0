// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>

#include "stgs/format/parallel.h"
#include "stream.h"

namespace stgs {
namespace {

using N = IssueNumber;
constexpr std::size_t kBlock = 256;  // primitives mapped at a time: their floats fit a cache
constexpr std::size_t kGrain = 64 * kBlock;  // primitives of a task
using Block = std::array<std::uint32_t, kBlock>;

// 2^e; e outside the normal range is clamped (spec 7.5.4).
float power_of_two(int e) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(std::clamp(e, -126, 127) + 127) << 23);
}

// Values [first, first + count) of the component whose digits `planes` are.
template <typename Value>
void load(const StreamRow& row, const Plane* planes, std::size_t first, std::size_t count,
          Value* out) {
  Value same = 0;
  int shift = 0;
  for (std::size_t d = 0; d < row.digits; shift += row.digit_bits[d++]) {
    if (planes[d].symbols == nullptr) same |= Value{planes[d].only} << shift;
  }
  std::fill_n(out, count, same);
  shift = 0;
  for (std::size_t d = 0; d < row.digits; shift += row.digit_bits[d++]) {
    if (planes[d].symbols == nullptr) continue;
    const std::uint8_t* from = planes[d].symbols + first;
    for (std::size_t i = 0; i < count; ++i) out[i] |= Value{from[i]} << shift;
  }
}

void undo_prediction(Prediction prediction, std::size_t count, std::uint32_t& carry,
                     std::uint32_t* q) {
  if (prediction == Prediction::kPlain) return;
  for (std::size_t i = 0; i < count; ++i) q[i] = unzigzag(q[i]);
  if (prediction == Prediction::kZigzag) return;
  for (std::size_t i = 0; i < count; ++i) q[i] = carry += q[i];
}

// Non-zero where some |q| does not fit 24 bits.
std::uint32_t excess(const std::uint32_t* q, std::size_t count) {
  std::uint32_t bad = 0;
  for (std::size_t i = 0; i < count; ++i) bad |= (q[i] + (1u << 24)) >> 25;
  return bad;
}

struct Output {
  float* to;  // first primitive of the block, first component
  std::size_t stride;
};

bool map_linear(const StreamRow& row, int component, const std::uint32_t* q, std::size_t count,
                Output out) {
  const float step = power_of_two(row.exponent);
  const float origin = row.origin[component % 3];
  for (std::size_t i = 0; i < count; ++i) {
    const auto integer = static_cast<float>(static_cast<std::int32_t>(q[i]));
    out.to[i * out.stride + static_cast<std::size_t>(component)] = origin + step * integer;
  }
  return excess(q, count) == 0;
}

// As map_linear, from the integer `base` on, |base| <= 2^25.
bool map_moment(const StreamRow& row, std::int64_t base, std::uint32_t* q, std::size_t count,
                Output out) {
  const bool good = excess(q, count) == 0;
  for (std::size_t i = 0; i < count; ++i) q[i] += static_cast<std::uint32_t>(base);
  return map_linear(row, 0, q, count, out) && good;
}

bool map_truncated(const StreamRow& row, const std::uint32_t* q, std::size_t count, Output out) {
  const std::uint64_t first = std::bit_cast<std::uint32_t>(row.origin[0]);
  bool good = true;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t bits = first + (std::uint64_t{q[i]} << row.exponent);
    good &= bits < 0x7F800000;
    out.to[i * out.stride] = std::bit_cast<float>(static_cast<std::uint32_t>(bits)) - row.origin[1];
  }
  return good && excess(q, count) == 0;
}

bool map_displacement(const StreamRow& row, int component, const std::uint32_t* q,
                      std::size_t count, const float* sigma, const float* radius,
                      std::uint32_t frames, Output out) {
  for (std::size_t i = 0; i < count; ++i) {
    const float step = power_of_two(row.exponent - lifespan_exponent(sigma[i], radius[i], frames));
    out.to[i * out.stride + static_cast<std::size_t>(component)] =
        step * static_cast<float>(static_cast<std::int32_t>(q[i]));
  }
  return excess(q, count) == 0;
}

// w from the unit length; exact but for the square root, which rounds correctly (spec 7.5.5).
// `log_scale` of the block's first primitive makes the exponent each one's own (spec 7.5.7); null:
// it is the entry's.
bool map_rotation(const StreamRow& row, const std::array<Block, 3>& q, std::size_t count,
                  const float* log_scale, Output out) {
  bool good = true;
  for (std::size_t i = 0; i < count; ++i) {
    int exponent = row.exponent;
    if (log_scale != nullptr) exponent += rotation_shift(log_scale + 3 * i);
    exponent = std::clamp(exponent, kFinestRotation, kCoarsestRotation);
    const float step = power_of_two(exponent);
    std::int64_t rest = std::int64_t{1} << (-2 * exponent);
    float* to = out.to + i * out.stride;
    for (std::size_t c = 0; c < 3; ++c) {
      const auto integer = static_cast<std::int32_t>(q[c][i]);
      rest -= std::int64_t{integer} * integer;
      to[c + 1] = step * static_cast<float>(integer);
    }
    good &= rest > 0;
    to[0] = step * std::sqrt(static_cast<float>(std::max<std::int64_t>(rest, 0)));
  }
  return good;
}

// Channels from luma and chroma, in integers (spec 7.5.6).
bool map_colour(const StreamRow& row, int component, const std::array<Block, 3>& q,
                std::size_t count, Output out) {
  const float step = power_of_two(row.exponent);
  float* to = out.to + component;
  for (std::size_t i = 0; i < count; ++i, to += out.stride) {
    const std::uint32_t luma = q[0][i], orange = q[1][i], green = q[2][i];
    const std::uint32_t rest = luma - green;
    to[0] = step * static_cast<float>(static_cast<std::int32_t>(rest + orange));
    to[1] = step * static_cast<float>(static_cast<std::int32_t>(luma + green));
    to[2] = step * static_cast<float>(static_cast<std::int32_t>(rest - orange));
  }
  return true;
}

bool map_float(int component, const std::uint32_t* q, std::size_t count, Output out) {
  for (std::size_t i = 0; i < count; ++i) {
    out.to[i * out.stride + static_cast<std::size_t>(component)] = std::bit_cast<float>(q[i]);
  }
  return true;
}

bool map_morton(const StreamRow& row, const Plane* planes, std::uint64_t first_key, std::size_t n,
                Output out) {
  const float step = power_of_two(row.exponent);
  std::array<std::uint64_t, kBlock> deltas;
  std::uint64_t key = first_key, overflow = first_key;
  for (std::size_t first = 0; first < n; first += kBlock) {
    const std::size_t count = std::min(kBlock, n - first);
    load(row, planes, first, count, deltas.data());
    for (std::size_t i = 0; i < count; ++i) {
      key += deltas[i];
      overflow |= key | deltas[i];
      float* to = out.to + (first + i) * out.stride;
      for (int axis = 0; axis < 3; ++axis) {
        to[axis] = row.origin[axis] + step * static_cast<float>(compact3(key >> axis));
      }
    }
  }
  return overflow >> 63 == 0;
}

// Of primitive `first` on, where the mapping wants them.
const float* log_scale_of(Mapping mapping, const Gaussians4D& set, std::size_t first) {
  return mapping == Mapping::kShapedRotation ? set.log_scale.data() + 3 * first : nullptr;
}

// Rows that this version may write: attribute by mapping (spec 7.5).
bool mapping_fits(const StreamRow& row) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      return row.exponent == 0;
    case Mapping::kLinear:
      return attribute != Attribute::kRotation && attribute != Attribute::kVelocity &&
             attribute != Attribute::kSigma && attribute != Attribute::kRadius;
    case Mapping::kTruncated:
      return (attribute == Attribute::kSigma || attribute == Attribute::kRadius) &&
             row.exponent >= 0 && row.exponent <= 23;
    case Mapping::kDisplacement:
      return attribute == Attribute::kVelocity;
    case Mapping::kColour:
      return attribute >= Attribute::kSh0;
    case Mapping::kMoment:
      return attribute == Attribute::kTime;
    case Mapping::kRotation:
    case Mapping::kShapedRotation:
      return attribute == Attribute::kRotation && row.exponent <= kCoarsestRotation &&
             row.exponent >= kFinestRotation;
  }
  return false;
}

// Values of 32 bits, Morton differences of 64; a byte of a stream that is not rANS is a digit.
bool digits_fit(const StreamRow& row, bool morton) {
  int bits = 0;
  for (std::size_t d = 0; d < row.digits; ++d) {
    const int width = row.digit_bits[d];
    if (width < 1 || width > 8) return false;
    if (static_cast<Coder>(row.coder) == Coder::kBytes && width != 8) return false;
    bits += width;
  }
  return row.digits >= 1 && bits <= (morton ? 64 : 32);
}

// Integers of a component, each of which may need the one before.
bool is_sequence(const StreamRow& row) {
  return static_cast<Prediction>(row.prediction) == Prediction::kDelta;
}

// Primitives [first, first + count) of a stream that is not Morton coded; first is a multiple of
// kBlock, or 0 where it is a sequence.
bool map_range(const StreamRow& row, std::span<const Plane> planes, const SegmentContext& context,
               std::size_t begin, std::size_t end, Gaussians4D& set) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  const auto mapping = static_cast<Mapping>(row.mapping);
  const AttributeView<float> view = view_of(set, attribute);
  const std::int64_t base = first_moment(context.begin, row.exponent);
  std::array<std::uint32_t, 32> carry{};
  std::array<Block, 3> q;  // three components at a time where they belong together
  const bool together = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation ||
                        mapping == Mapping::kColour;
  bool good = true;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    const Output out{view.data + first * view.stride, view.stride};
    for (int c = 0; c < row.components; ++c) {
      const auto component = static_cast<std::size_t>(c);
      std::uint32_t* block = q[together ? component % 3 : 0].data();
      load(row, planes.data() + component * row.digits, first, count, block);
      undo_prediction(static_cast<Prediction>(row.prediction), count, carry[component], block);
      switch (mapping) {
        case Mapping::kFloat:
          good &= map_float(c, block, count, out);
          break;
        case Mapping::kLinear:
          good &= map_linear(row, c, block, count, out);
          break;
        case Mapping::kMoment:
          good &= map_moment(row, base, block, count, out);
          break;
        case Mapping::kTruncated:
          good &= map_truncated(row, block, count, out);
          break;
        case Mapping::kDisplacement:
          good &= map_displacement(row, c, block, count, set.sigma.data() + first,
                                   set.radius.data() + first, context.frames, out);
          break;
        case Mapping::kRotation:
        case Mapping::kShapedRotation:
          good &= excess(block, count) == 0;
          if (c == 2) good &= map_rotation(row, q, count, log_scale_of(mapping, set, first), out);
          break;
        case Mapping::kColour:
          good &= excess(block, count) == 0;
          if (c % 3 == 2) good &= map_colour(row, c - 2, q, count, out);
          break;
      }
    }
  }
  return good;
}

}  // namespace

int rotation_shift(const float* log_scale) {
  const auto [least, most] = std::minmax({log_scale[0], log_scale[1], log_scale[2]});
  const float length = most - least;
  int shift = 3;
  for (const float limit : {0.125f, 0.5f, 1.25f, 2.375f, 3.75f, 5.0f}) shift -= length >= limit;
  return shift;
}

int lifespan_exponent(float sigma, float radius, std::uint32_t frames) {
  const float lifespan = std::min(radius + 2.0f * sigma, static_cast<float>(frames));
  return static_cast<int>(std::bit_cast<std::uint32_t>(lifespan) >> 23 & 0xFF) - 127;
}

std::int64_t first_moment(double begin, int exponent) {
  constexpr double kLimit = 2.0 * kMaxInteger;
  return static_cast<std::int64_t>(
      std::clamp(std::floor(std::ldexp(begin, -exponent)), -kLimit, kLimit));
}

bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  const auto mapping = static_cast<Mapping>(row.mapping);
  const auto prediction = static_cast<Prediction>(row.prediction);
  if (attribute < Attribute::kPosition || attribute > Attribute::kSh3) {
    findings.unsupported(N::kStreamUnsupported, offset, "layouts: attribute {} is unknown",
                         row.attribute);
    return false;
  }
  if (mapping > Mapping::kMoment || prediction > Prediction::kMorton) {
    findings.unsupported(N::kStreamUnsupported, offset,
                         "layouts, {}: mapping {} or prediction {} is unknown to this version",
                         name_of(attribute), row.mapping, row.prediction);
    return false;
  }
  const bool morton = prediction == Prediction::kMorton;
  const bool rotation = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation;
  const bool position = attribute == Attribute::kPosition && mapping == Mapping::kLinear;
  const int components = morton ? 1 : rotation ? 3 : components_of(attribute);
  const bool bits_plain = mapping != Mapping::kFloat || prediction == Prediction::kPlain;
  if (mapping_fits(row) && row.components == components && (!morton || position) && bits_plain &&
      digits_fit(row, morton)) {
    return true;
  }
  findings.error(N::kStreamShape, offset,
                 "layouts, {}: mapping {} with prediction {}, coder {}, {} components of {} digits "
                 "and exponent {} is not allowed",
                 name_of(attribute), row.mapping, row.prediction, row.coder, row.components,
                 row.digits, row.exponent);
  return false;
}

bool map_stream(const StreamRow& row, std::span<const Plane> planes, const SegmentContext& context,
                StreamPlace place, Gaussians4D& set, Findings& findings) {
  const std::size_t n = set.size();
  std::atomic<bool> good = true;
  if (static_cast<Prediction>(row.prediction) == Prediction::kMorton) {
    const AttributeView<float> view = view_of(set, Attribute::kPosition);
    good = map_morton(row, planes.data(), context.first_key, n, {view.data, view.stride});
  } else {
    parallel_blocks(std::size_t{0}, n, is_sequence(row) ? n : kGrain,
                    [&](std::size_t begin, std::size_t end) {
                      if (!map_range(row, planes, context, begin, end, set)) good = false;
                    });
  }
  if (!good) {
    findings.error(N::kStreamValue, place.offset, "segment {}, {}: an integer is out of range",
                   place.segment, name_of(static_cast<Attribute>(row.attribute)));
  }
  return good;
}

}  // namespace stgs
