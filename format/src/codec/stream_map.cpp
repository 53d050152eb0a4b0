// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "codec/draco_points.h"
#include "codec/stream_map.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using N = IssueNumber;
constexpr std::size_t kMapGrain = 16384;  // primitives per task
constexpr std::size_t kMapRun = 128;  // primitives mapped for all streams in turn: fits the cache
using Carries = std::array<std::uint64_t, kMaxComponents>;

constexpr float min_origin() {
  return std::bit_cast<float>(static_cast<std::uint32_t>(kMinExponent + 127) << 23);
}

// Returns whether arithmetic with the row's numbers stays normal and finite (spec 7.5).
bool numbers_fit(const StreamRow& row) {
  const auto fits = [](float v) {
    const float size = std::abs(v);
    return v == 0.0f || (size >= min_origin() && size <= std::bit_cast<float>(kMaxTruncated));
  };
  return row.step.exponent >= kMinExponent && row.step.exponent <= kMaxExponent &&
         row.step.multiplier % 2 == 1 &&
         std::all_of(std::begin(row.origin), std::end(row.origin), fits);
}

// Returns whether the mapping is allowed for the attribute (spec 7.5).
bool mapping_fits(const StreamRow& row) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      return row.step == Step{};
    case Mapping::kLinear:
      return attribute != Attribute::kRotation && attribute != Attribute::kVelocity &&
             attribute != Attribute::kSigma && attribute != Attribute::kRadius;
    case Mapping::kTruncated:
      return (attribute == Attribute::kSigma || attribute == Attribute::kRadius) &&
             row.step.exponent >= 0 && row.step.exponent <= 23 && row.origin[0] >= min_origin();
    case Mapping::kDisplacement:
      return attribute == Attribute::kVelocity;
    case Mapping::kColour:
      return attribute >= Attribute::kSh0;
    case Mapping::kTime:
      return attribute == Attribute::kTime;
    case Mapping::kRotation:
    case Mapping::kShapedRotation:
      return attribute == Attribute::kRotation && row.step.exponent <= kMaxRotationExponent &&
             row.step.exponent >= kMinRotationExponent;
  }
  return false;
}

// Returns whether the coder is allowed: Draco stores positions with plain prediction, in three
// digits.
bool coder_fits(const StreamRow& row) {
  if (static_cast<Coder>(row.coder) != Coder::kDraco) return true;
  return static_cast<Attribute>(row.attribute) == Attribute::kPosition &&
         static_cast<Mapping>(row.mapping) == Mapping::kLinear &&
         static_cast<Prediction>(row.prediction) == Prediction::kPlain &&
         row.digits == kDracoDigits;
}

// Returns whether the digits are allowed: values of up to 32 bits, or 64 for Morton differences,
// and digits of 8 bits unless the coder is rANS.
bool digits_fit(const StreamRow& row, bool morton) {
  int bits = 0;
  for (std::size_t d = 0; d < row.digits; ++d) {
    const int width = row.digit_bits[d];
    if (width < 1 || width > 8) return false;
    if (static_cast<Coder>(row.coder) != Coder::kRans && width != 8) return false;
    bits += width;
  }
  return row.digits >= 1 && bits <= (morton ? 64 : 32);
}

}  // namespace

std::int64_t time_origin(double begin, Step step) {
  constexpr double kLimit = 2.0 * kMaxInteger;
  const double steps = begin / std::ldexp(step.multiplier, step.exponent);
  return static_cast<std::int64_t>(std::clamp(std::floor(steps), -kLimit, kLimit));
}

bool is_known(const StreamRow& row) {
  return row.attribute >= static_cast<int>(Attribute::kPosition) &&
         row.attribute <= static_cast<int>(Attribute::kSh3) &&
         row.mapping <= static_cast<int>(Mapping::kTime) &&
         row.prediction <= static_cast<int>(Prediction::kMorton) &&
         row.coder <= static_cast<int>(Coder::kDraco);
}

bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  const auto mapping = static_cast<Mapping>(row.mapping);
  const auto prediction = static_cast<Prediction>(row.prediction);
  const bool morton = prediction == Prediction::kMorton;
  const bool rotation = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation;
  const bool position = attribute == Attribute::kPosition && mapping == Mapping::kLinear;
  const int components = morton ? 1 : rotation ? 3 : components_of(attribute);
  const bool bits_plain = mapping != Mapping::kFloat || prediction == Prediction::kPlain;
  if (numbers_fit(row) && mapping_fits(row) && row.components == components &&
      (!morton || position) && bits_plain && digits_fit(row, morton) && coder_fits(row)) {
    return true;
  }
  findings.error(N::kStreamShape, offset,
                 "layouts, {}: invalid combination of mapping {}, prediction {}, coder {}, {} "
                 "components of {} "
                 "digits, step {} * 2^{} and origin {} {} {}",
                 name_of(attribute), row.mapping, row.prediction, row.coder, row.components,
                 row.digits, row.step.multiplier, row.step.exponent, row.origin[0], row.origin[1],
                 row.origin[2]);
  return false;
}

MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      Gaussians4D& set) {
  const std::size_t n = set.size(), chunks = (n + kMapGrain - 1) / kMapGrain;
  // For each chunk, the sums of all differences before it.
  std::vector<Carries> carries(chunks * tasks.size(), Carries{});
  const auto is_sum = [&](std::size_t t) {
    return static_cast<Prediction>(tasks[t].row->prediction) >= Prediction::kDelta;
  };
  parallel_for(std::size_t{0}, (chunks - 1) * tasks.size(), [&](std::size_t job) {
    const std::size_t chunk = job / tasks.size(), t = job % tasks.size();
    if (!is_sum(t)) return;
    sum_task(tasks[t], chunk * kMapGrain, (chunk + 1) * kMapGrain,
             carries[job + tasks.size()].data());
  });
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    const auto prediction = static_cast<Prediction>(tasks[t].row->prediction);
    if (prediction == Prediction::kMorton) carries[t][0] = context.first_key;
    for (std::size_t k = t + tasks.size(); k < carries.size(); k += tasks.size()) {
      for (std::size_t c = 0; c < kMaxComponents; ++c)
        carries[k][c] += carries[k - tasks.size()][c];
    }
  }
  std::uint32_t floats = 0;
  for (const StreamTask& task : tasks) {
    if (static_cast<Mapping>(task.row->mapping) != Mapping::kFloat) continue;
    floats |= attribute_bit(static_cast<Attribute>(task.row->attribute));
  }
  std::vector<std::uint8_t> bad(chunks * (tasks.size() + 1), 0);
  const auto map_chunk = [&](std::size_t chunk) {
    const std::size_t end = std::min(n, (chunk + 1) * kMapGrain);
    std::uint8_t* const found = bad.data() + chunk * (tasks.size() + 1);
    for (std::size_t first = chunk * kMapGrain; first < end; first += kMapRun) {
      const std::size_t last = std::min(end, first + kMapRun);
      for (std::size_t t = 0; t < tasks.size(); ++t) {
        std::uint64_t* const carry = carries[chunk * tasks.size() + t].data();
        if (!map_task(tasks[t], context, first, last, carry, set)) found[t] = 1;
      }
      if (!all_renderable(set, floats, first, last)) found[tasks.size()] = 1;
    }
  };
  if (chunks == 1) {
    map_chunk(0);
  } else {
    parallel_for(std::size_t{0}, chunks, map_chunk);
  }
  MapResult out;
  out.in_range.assign(tasks.size(), true);
  for (std::size_t k = 0; k < bad.size(); ++k) {
    const std::size_t t = k % (tasks.size() + 1);
    if (bad[k] == 0) continue;
    if (t == tasks.size()) {
      out.renderable = false;
    } else {
      out.in_range[t] = false;
    }
  }
  return out;
}

}  // namespace stgs
