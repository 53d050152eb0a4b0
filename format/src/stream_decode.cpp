// SPDX-License-Identifier: Apache-2.0
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "container.h"
#include "stream.h"

namespace stgs {
namespace {

using N = IssueNumber;
constexpr std::size_t kBlock = 256;  // primitives mapped at a time: their floats fit a cache
using Block = std::array<std::uint32_t, kBlock>;

// 2^e; e outside the normal range is clamped (spec 7.5.4).
float power_of_two(int e) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(std::clamp(e, -126, 127) + 127) << 23);
}

// Adds digit number `digit` of `count` values; `from` is the byte of the first, which begins it.
template <int kDigitBits>
void add_digit(const std::uint8_t* from, int digit, std::size_t count, std::uint32_t* out) {
  constexpr std::size_t kPerByte = 8 / kDigitBits;
  constexpr std::uint32_t kMask = (1u << kDigitBits) - 1;
  const int shift = kDigitBits * digit;
  const std::size_t whole = count / kPerByte;
  for (std::size_t b = 0; b < whole; ++b) {
    for (std::size_t i = 0; i < kPerByte; ++i) {
      out[b * kPerByte + i] |= (std::uint32_t{from[b]} >> (i * kDigitBits) & kMask) << shift;
    }
  }
  for (std::size_t i = whole * kPerByte; i < count; ++i) {
    out[i] |= (std::uint32_t{from[whole]} >> (i % kPerByte * kDigitBits) & kMask) << shift;
  }
}

// Values [first, first + count) of a component of n values; first is a multiple of 8.
void load(const StreamEntry& entry, const std::uint8_t* planes, std::size_t n, std::size_t first,
          std::size_t count, std::uint32_t* out) {
  std::fill_n(out, count, 0u);
  const std::size_t plane = plane_bytes(n, entry.digit_bits);
  const std::uint8_t* from = planes + first * entry.digit_bits / 8;
  for (int digit = 0; digit < entry.digits; ++digit, from += plane) {
    switch (entry.digit_bits) {
      case 2:
        add_digit<2>(from, digit, count, out);
        break;
      case 4:
        add_digit<4>(from, digit, count, out);
        break;
      default:
        add_digit<8>(from, digit, count, out);
        break;
    }
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

bool map_linear(const StreamEntry& entry, int component, const std::uint32_t* q, std::size_t count,
                Output out) {
  const float step = power_of_two(entry.exponent);
  const float origin = entry.origin[component % 3];
  for (std::size_t i = 0; i < count; ++i) {
    const auto integer = static_cast<float>(static_cast<std::int32_t>(q[i]));
    out.to[i * out.stride + static_cast<std::size_t>(component)] = origin + step * integer;
  }
  return excess(q, count) == 0;
}

bool map_truncated(const StreamEntry& entry, const std::uint32_t* q, std::size_t count,
                   Output out) {
  const std::uint64_t first = std::bit_cast<std::uint32_t>(entry.origin[0]);
  bool good = true;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t bits = first + (std::uint64_t{q[i]} << entry.exponent);
    good &= bits < 0x7F800000;
    out.to[i * out.stride] =
        std::bit_cast<float>(static_cast<std::uint32_t>(bits)) - entry.origin[1];
  }
  return good && excess(q, count) == 0;
}

bool map_displacement(const StreamEntry& entry, int component, const std::uint32_t* q,
                      std::size_t count, const float* sigma, const float* radius,
                      std::uint32_t frames, Output out) {
  for (std::size_t i = 0; i < count; ++i) {
    const float step =
        power_of_two(entry.exponent - lifespan_exponent(sigma[i], radius[i], frames));
    out.to[i * out.stride + static_cast<std::size_t>(component)] =
        step * static_cast<float>(static_cast<std::int32_t>(q[i]));
  }
  return excess(q, count) == 0;
}

// w from the unit length; exact but for the square root, which rounds correctly (spec 7.5.5).
// `log_scale` of the block's first primitive makes the exponent each one's own (spec 7.5.7); null:
// it is the entry's.
bool map_rotation(const StreamEntry& entry, const std::array<Block, 3>& q, std::size_t count,
                  const float* log_scale, Output out) {
  bool good = true;
  for (std::size_t i = 0; i < count; ++i) {
    int exponent = entry.exponent;
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
bool map_colour(const StreamEntry& entry, int component, const std::array<Block, 3>& q,
                std::size_t count, Output out) {
  const float step = power_of_two(entry.exponent);
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

bool map_morton(const StreamEntry& entry, const std::uint8_t* planes, std::size_t n, Output out) {
  float step = power_of_two(entry.exponent);
  std::uint64_t key = 0, overflow = 0;
  for (std::size_t i = 0; i < n; ++i) {
    std::uint64_t delta = 0;
    for (int plane = 0; plane < entry.digits; ++plane) {
      delta |= std::uint64_t{planes[static_cast<std::size_t>(plane) * n + i]} << (8 * plane);
    }
    key += delta;
    overflow |= key | delta;
    float* to = out.to + i * out.stride;
    for (int axis = 0; axis < 3; ++axis) {
      to[axis] = entry.origin[axis] + step * static_cast<float>(compact3(key >> axis));
    }
  }
  return overflow >> 63 == 0;
}

// Of primitive `first` on, where the mapping wants them.
const float* log_scale_of(Mapping mapping, const Gaussians4D& set, std::size_t first) {
  return mapping == Mapping::kShapedRotation ? set.log_scale.data() + 3 * first : nullptr;
}

// Rows that this version may write: attribute by mapping (spec 7.5).
bool mapping_fits(const StreamEntry& entry) {
  const auto attribute = static_cast<Attribute>(entry.attribute);
  switch (static_cast<Mapping>(entry.mapping)) {
    case Mapping::kFloat:
      return entry.exponent == 0;
    case Mapping::kLinear:
      return attribute != Attribute::kRotation && attribute != Attribute::kVelocity &&
             attribute != Attribute::kSigma && attribute != Attribute::kRadius;
    case Mapping::kTruncated:
      return (attribute == Attribute::kSigma || attribute == Attribute::kRadius) &&
             entry.exponent >= 0 && entry.exponent <= 23;
    case Mapping::kDisplacement:
      return attribute == Attribute::kVelocity;
    case Mapping::kColour:
      return attribute >= Attribute::kSh0;
    case Mapping::kRotation:
    case Mapping::kShapedRotation:
      return attribute == Attribute::kRotation && entry.exponent <= kCoarsestRotation &&
             entry.exponent >= kFinestRotation;
  }
  return false;
}

// Values of 32 bits, Morton differences of 64 in whole bytes (spec 7.3).
bool digits_fit(const StreamEntry& entry, bool morton) {
  const int bits = entry.digit_bits * entry.digits;
  if (morton) return entry.digit_bits == 8 && bits >= 8 && bits <= 64;
  const bool width = entry.digit_bits == 2 || entry.digit_bits == 4 || entry.digit_bits == 8;
  return width && bits >= 1 && bits <= 32;
}

// Bytes of all planes of a stream (spec 7.3).
std::uint64_t planes_bytes(const StreamEntry& entry, std::uint64_t primitives) {
  return plane_bytes(primitives, entry.digit_bits) * entry.components * entry.digits;
}

// What is wrong with the one frame that `stored` must be (spec 7.2), or null.
const char* decompress(std::span<const std::uint8_t> stored, std::vector<std::uint8_t>& planes) {
  const std::size_t frame = ZSTD_findFrameCompressedSize(stored.data(), stored.size());
  if (ZSTD_isError(frame)) return ZSTD_getErrorName(frame);
  if (frame != stored.size()) return "bytes after the frame";
  const std::size_t got =
      ZSTD_decompress(planes.data(), planes.size(), stored.data(), stored.size());
  if (ZSTD_isError(got)) return ZSTD_getErrorName(got);
  return got == planes.size() ? nullptr : "another size";
}

bool padding_is_zero(const StreamEntry& entry, std::span<const std::uint8_t> planes,
                     std::uint64_t primitives) {
  const std::uint64_t used = primitives * entry.digit_bits % 8;  // bits of a plane's last byte
  if (used == 0) return true;
  const std::uint64_t plane = plane_bytes(primitives, entry.digit_bits);
  unsigned excess_bits = 0;
  for (std::uint64_t end = plane; end <= planes.size(); end += plane)
    excess_bits |= unsigned{planes[end - 1]} >> used;
  return excess_bits == 0;
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

bool check_entry(const StreamEntry& entry, StreamPlace place, Findings& findings) {
  const auto attribute = static_cast<Attribute>(entry.attribute);
  const char* name = name_of(attribute);
  if (entry.mapping > static_cast<int>(Mapping::kShapedRotation) || entry.prediction > 3 ||
      entry.coder > 1) {
    findings.unsupported(N::kStreamUnsupported, place.offset,
                         "segment {}, {}: mapping {}, prediction {}, coder {}: one of them is "
                         "unknown to this version",
                         place.segment, name, entry.mapping, entry.prediction, entry.coder);
    return false;
  }
  const auto prediction = static_cast<Prediction>(entry.prediction);
  const bool morton = prediction == Prediction::kMorton;
  const bool rotation = static_cast<Mapping>(entry.mapping) == Mapping::kRotation ||
                        static_cast<Mapping>(entry.mapping) == Mapping::kShapedRotation;
  const bool position =
      attribute == Attribute::kPosition && static_cast<Mapping>(entry.mapping) == Mapping::kLinear;
  const int components = morton ? 1 : rotation ? 3 : components_of(attribute);
  const bool bits_plain =
      static_cast<Mapping>(entry.mapping) != Mapping::kFloat || prediction == Prediction::kPlain;
  if (!mapping_fits(entry) || entry.components != components || (morton && !position) ||
      !bits_plain || !digits_fit(entry, morton)) {
    findings.error(
        N::kStreamShape, place.offset,
        "segment {}, {}: mapping {} with prediction {}, {} components of {} digits of {} "
        "bits and exponent {} is not allowed",
        place.segment, name, entry.mapping, entry.prediction, entry.components, entry.digits,
        entry.digit_bits, entry.exponent);
    return false;
  }
  return true;
}

bool check_size(const StreamEntry& entry, std::span<const std::uint8_t> stored,
                std::uint64_t primitives, StreamPlace place, Findings& findings) {
  const std::uint64_t size = planes_bytes(entry, primitives);
  bool good = stored.size() == size;
  if (static_cast<Coder>(entry.coder) == Coder::kZstd) {
    good = ZSTD_getFrameContentSize(stored.data(), stored.size()) == size &&
           size / kMaxExpansion <= stored.size();
  }
  if (!good) {
    findings.error(N::kStreamCorrupt, place.offset,
                   "segment {}, {}: the stream does not hold the {} bytes of {} primitives",
                   place.segment, name_of(static_cast<Attribute>(entry.attribute)), size,
                   primitives);
  }
  return good;
}

bool decode_planes(const StreamEntry& entry, std::span<const std::uint8_t> stored,
                   std::uint64_t primitives, StreamPlace place, std::vector<std::uint8_t>& planes,
                   Findings& findings) {
  const char* name = name_of(static_cast<Attribute>(entry.attribute));
  planes.resize(planes_bytes(entry, primitives));
  if (static_cast<Coder>(entry.coder) == Coder::kZstd) {
    if (const char* problem = decompress(stored, planes); problem != nullptr) {
      findings.error(N::kStreamCorrupt, place.offset, "segment {}, {}: zstd: {}", place.segment,
                     name, problem);
      return false;
    }
  } else {
    std::copy(stored.begin(), stored.end(), planes.begin());
  }
  if (checksum(planes) != entry.checksum) {
    findings.error(N::kStreamChecksum, place.offset, "segment {}, {}: decoded bytes are wrong",
                   place.segment, name);
    return false;
  }
  if (!padding_is_zero(entry, planes, primitives)) {
    findings.error(N::kStreamPadding, place.offset,
                   "segment {}, {}: bits behind the last primitive are not 0", place.segment, name);
    return false;
  }
  return true;
}

bool map_planes(const StreamEntry& entry, std::span<const std::uint8_t> planes,
                std::uint32_t frames, StreamPlace place, Gaussians4D& set, Findings& findings) {
  const auto attribute = static_cast<Attribute>(entry.attribute);
  const auto mapping = static_cast<Mapping>(entry.mapping);
  const auto prediction = static_cast<Prediction>(entry.prediction);
  const AttributeView<float> view = view_of(set, attribute);
  const std::size_t n = set.size();
  bool good = true;
  if (prediction == Prediction::kMorton) {
    good = map_morton(entry, planes.data(), n, {view.data, view.stride});
  } else {
    std::array<std::uint32_t, 32> carry{};
    std::array<Block, 3> q;  // three components at a time where they belong together
    const bool together = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation ||
                          mapping == Mapping::kColour;
    const std::size_t component_bytes = plane_bytes(n, entry.digit_bits) * entry.digits;
    for (std::size_t first = 0; first < n; first += kBlock) {
      const std::size_t count = std::min(kBlock, n - first);
      const Output out{view.data + first * view.stride, view.stride};
      for (int c = 0; c < entry.components; ++c) {
        std::uint32_t* block = q[together ? static_cast<std::size_t>(c) % 3 : 0].data();
        load(entry, planes.data() + static_cast<std::size_t>(c) * component_bytes, n, first, count,
             block);
        undo_prediction(prediction, count, carry[static_cast<std::size_t>(c)], block);
        switch (mapping) {
          case Mapping::kFloat:
            good &= map_float(c, block, count, out);
            break;
          case Mapping::kLinear:
            good &= map_linear(entry, c, block, count, out);
            break;
          case Mapping::kTruncated:
            good &= map_truncated(entry, block, count, out);
            break;
          case Mapping::kDisplacement:
            good &= map_displacement(entry, c, block, count, set.sigma.data() + first,
                                     set.radius.data() + first, frames, out);
            break;
          case Mapping::kRotation:
          case Mapping::kShapedRotation:
            good &= excess(block, count) == 0;
            if (c == 2)
              good &= map_rotation(entry, q, count, log_scale_of(mapping, set, first), out);
            break;
          case Mapping::kColour:
            good &= excess(block, count) == 0;
            if (c % 3 == 2) good &= map_colour(entry, c - 2, q, count, out);
            break;
        }
      }
    }
  }
  if (!good) {
    findings.error(N::kStreamValue, place.offset, "segment {}, {}: an integer is out of range",
                   place.segment, name_of(attribute));
  }
  return good;
}

}  // namespace stgs
