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
using Carries = std::array<std::uint32_t, kMaxComponents>;

constexpr float min_origin() {
  return std::bit_cast<float>(static_cast<std::uint32_t>(kMinExponent + 127) << 23);
}

// Returns whether arithmetic with the row's numbers stays normal and finite (spec 8.5).
bool numbers_fit(const StreamRow& row) {
  const auto fits = [](float v) {
    const float size = std::abs(v);
    return v == 0.0f || (size >= min_origin() && size <= std::bit_cast<float>(kMaxTruncated));
  };
  return row.step.exponent >= kMinExponent && row.step.exponent <= kMaxExponent &&
         row.step.multiplier % 2 == 1 &&
         std::all_of(std::begin(row.origin), std::end(row.origin), fits);
}

// Returns whether the mapping is allowed for the attribute (spec 8.5).
bool mapping_fits(const StreamRow& row) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      return attribute != Attribute::kShDegree && row.step.multiplier == 1 &&
             row.step.exponent >= 0 && row.step.exponent <= kMaxDroppedBits;
    case Mapping::kLinear:
      return attribute == Attribute::kPosition || attribute == Attribute::kLogScale ||
             attribute == Attribute::kOpacity || attribute == Attribute::kSh0 ||
             band_of(attribute) > 0;
    case Mapping::kTruncated:
      return (attribute == Attribute::kSigma || attribute == Attribute::kRadius) &&
             row.step.exponent >= 0 && row.step.exponent <= 23 && row.origin[0] >= min_origin();
    case Mapping::kDisplacement:
      return attribute == Attribute::kVelocity;
    case Mapping::kColour:
      return attribute == Attribute::kSh0 || band_of(attribute) > 0;
    case Mapping::kTime:
      return attribute == Attribute::kTime;
    case Mapping::kInteger:
      return attribute == Attribute::kShDegree && row.step == Step{};
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

// Returns whether the digits are allowed: values of up to 32 bits, and digits of 8 bits unless the
// coder is rANS.
bool digits_fit(const StreamRow& row) {
  int bits = 0;
  for (std::size_t d = 0; d < row.digits; ++d) {
    const int width = row.digit_bits[d];
    if (width < 1 || width > 8) return false;
    if (static_cast<Coder>(row.coder) != Coder::kRans && width != 8) return false;
    bits += width;
  }
  const bool whole_low = static_cast<Coder>(row.coder) == Coder::kRans || row.low % 8 == 0;
  return row.digits >= 1 && bits <= 32 && whole_low;
}

}  // namespace

double time_base(double begin, Step step) {
  return begin - std::fmod(begin, std::ldexp(step.multiplier, step.exponent));
}

int part_exponent_of(double ticks) {
  return std::ilogb(ticks);
}

std::array<std::uint32_t, 6> shape_bounds(Step log_scale) {
  constexpr std::array kEighths = {1, 4, 10, 19, 30, 40};  // of a natural logarithm
  std::array<std::uint32_t, kEighths.size()> out{};
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double steps =
        std::ceil(kEighths[k] / std::ldexp(log_scale.multiplier, log_scale.exponent + 3));
    out[k] = static_cast<std::uint32_t>(std::min(steps, 4294967295.0));
  }
  return out;
}

bool is_known(const StreamRow& row) {
  return row.attribute >= static_cast<int>(Attribute::kPosition) &&
         row.attribute <= static_cast<int>(Attribute::kSh3) &&
         row.mapping <= static_cast<int>(Mapping::kInteger) &&
         row.prediction <= static_cast<int>(Prediction::kMorton) &&
         row.coder <= static_cast<int>(Coder::kDraco);
}

int components_in_planes(const StreamRow& row) {
  const auto mapping = static_cast<Mapping>(row.mapping);
  if (static_cast<Prediction>(row.prediction) == Prediction::kMorton) return 1;
  if (mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation) return 3;
  return components_of(static_cast<Attribute>(row.attribute));
}

bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings) {
  const auto attribute = static_cast<Attribute>(row.attribute);
  const auto mapping = static_cast<Mapping>(row.mapping);
  const auto prediction = static_cast<Prediction>(row.prediction);
  const bool morton = prediction == Prediction::kMorton;
  const bool position = attribute == Attribute::kPosition && mapping == Mapping::kLinear;
  const bool plain = prediction == Prediction::kPlain ||
                     (mapping != Mapping::kFloat && mapping != Mapping::kInteger);
  if (numbers_fit(row) && mapping_fits(row) && (morton ? position : row.low == 0) && plain &&
      digits_fit(row) && coder_fits(row)) {
    return true;
  }
  findings.error(N::kStreamShape, offset,
                 "layouts, {}: invalid combination of mapping {}, prediction {}, coder {}, {} "
                 "digits, {} low bits, step {} * 2^{} and origin {} {} {}",
                 name_of(attribute), row.mapping, row.prediction, row.coder, row.digits, row.low,
                 row.step.multiplier, row.step.exponent, row.origin[0], row.origin[1],
                 row.origin[2]);
  return false;
}

MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set) {
  const std::size_t chunks = (n + kMapGrain - 1) / kMapGrain;
  // For each chunk, the sums of all differences before it.
  std::vector<Carries> carries(chunks * tasks.size(), Carries{});
  const auto is_sum = [&](std::size_t t) {
    return static_cast<Prediction>(tasks[t].row->prediction) >= Prediction::kDelta;
  };
  const auto size_of_task = [&](std::size_t t) {
    return tasks[t].members.empty() ? n : tasks[t].members.size();
  };
  parallel_for(std::size_t{0}, (chunks - 1) * tasks.size(), [&](std::size_t job) {
    const std::size_t chunk = job / tasks.size(), t = job % tasks.size();
    if (!is_sum(t)) return;
    sum_task(tasks[t], chunk * kMapGrain, std::min(size_of_task(t), (chunk + 1) * kMapGrain),
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
  std::uint32_t floats = 0, attributes = 0;
  for (const StreamTask& task : tasks) {
    const std::uint32_t bit = attribute_bit(static_cast<Attribute>(task.row->attribute));
    attributes |= bit;
    if (static_cast<Mapping>(task.row->mapping) == Mapping::kFloat) floats |= bit;
  }
  // Runs of SH above degree 0 are of other primitives.
  const std::uint32_t sh = floats & ~(attribute_bit(Attribute::kShDegree) - 1);
  std::vector<std::uint8_t> bad(chunks * (tasks.size() + 1), 0);
  const auto is_partial = [](const StreamTask& task) { return !task.members.empty(); };
  const auto map_chunk = [&](std::size_t chunk, bool partial) {
    const std::size_t end = std::min(n, (chunk + 1) * kMapGrain);
    std::uint8_t* const found = bad.data() + chunk * (tasks.size() + 1);
    MapRun run;
    for (std::size_t first = chunk * kMapGrain; first < end; first += kMapRun) {
      if (!partial && !set.sh.empty()) {
        const auto stride = static_cast<std::size_t>(3 * set.sh_coefficients());
        run.sh = set.sh.data() + first * stride;
        run.sh_end = set.sh.data() + std::min(end, first + kMapRun) * stride;
      }
      for (std::size_t t = 0; t < tasks.size(); ++t) {
        if (is_partial(tasks[t]) != partial) continue;
        const std::size_t last = std::min({end, first + kMapRun, size_of_task(t)});
        std::uint32_t* const carry = carries[chunk * tasks.size() + t].data();
        if (first < last && !map_task(tasks[t], context, first, last, carry, run, set))
          found[t] = 1;
      }
      if (!partial &&
          !all_renderable(set, attributes, floats & ~sh, first, std::min(end, first + kMapRun))) {
        found[tasks.size()] = 1;
      }
    }
  };
  // SH that some primitives lack are stored last, because SH of degree 0 set them to 0.
  for (const bool partial : {false, true}) {
    if (partial && std::none_of(tasks.begin(), tasks.end(), is_partial)) break;
    if (chunks == 1) {
      map_chunk(0, partial);
    } else {
      parallel_for(std::size_t{0}, chunks, [&](std::size_t c) { map_chunk(c, partial); });
    }
  }
  MapResult out;
  out.in_range.assign(tasks.size(), true);
  out.renderable = sh == 0 || all_renderable(set, 0, sh, 0, n);
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
