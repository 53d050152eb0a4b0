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
// Primitives per task of several threads. A single thread maps all in turn, without the sums before
// each chunk.
constexpr std::size_t kMapGrain = 16384;

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

namespace {

// Returns the values of a component of a task for n primitives.
std::size_t values_of(const StreamTask& task, std::size_t n) {
  return task.members.empty() ? n : task.members.size();
}

// Returns the carries before each chunk of n primitives, by task: the sums of all differences
// before it, and those before the first primitive.
std::vector<Carries> carries_of(std::span<const StreamTask> tasks,
                                const std::vector<Carries>& first, std::size_t chunks,
                                std::size_t grain, std::size_t n) {
  std::vector<Carries> out(chunks * tasks.size(), Carries{});
  parallel_for(std::size_t{0}, (chunks - 1) * tasks.size(), [&](std::size_t job) {
    const std::size_t chunk = job / tasks.size();
    const StreamTask& task = tasks[job % tasks.size()];
    if (static_cast<Prediction>(task.row->prediction) < Prediction::kDelta) return;
    sum_task(task, chunk * grain, std::min(values_of(task, n), (chunk + 1) * grain),
             out[job + tasks.size()].data());
  });
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    out[t] = first[t];
    for (std::size_t k = t + tasks.size(); k < out.size(); k += tasks.size()) {
      for (std::size_t c = 0; c < kMaxComponents; ++c) out[k][c] += out[k - tasks.size()][c];
    }
  }
  return out;
}

// Sets of attributes, by attribute_bit().
struct MappedAttributes {
  std::uint32_t all = 0;     // of the tasks
  std::uint32_t floats = 0;  // those with the mapping kFloat
  // Of `floats`, SH above degree 0, whose runs are of other primitives.
  std::uint32_t floats_of_sh() const { return floats & ~(attribute_bit(Attribute::kShDegree) - 1); }
};

MappedAttributes mapped_attributes(std::span<const StreamTask> tasks) {
  MappedAttributes out;
  for (const StreamTask& task : tasks) {
    const std::uint32_t bit = attribute_bit(static_cast<Attribute>(task.row->attribute));
    out.all |= bit;
    if (static_cast<Mapping>(task.row->mapping) == Mapping::kFloat) out.floats |= bit;
  }
  return out;
}

// Maps the tasks of n primitives, chunk by chunk.
class StreamMapper {
 public:
  StreamMapper(std::span<const StreamTask> tasks, const SegmentContext& context, std::size_t n,
               Gaussians4D& set, const std::vector<Carries>& carries)
      : tasks_(tasks),
        context_(context),
        n_(n),
        set_(set),
        grain_(concurrency() == 1 ? std::max<std::size_t>(n, 1) : kMapGrain),
        chunks_((n + grain_ - 1) / grain_),
        carries_(carries_of(tasks, carries, chunks_, grain_, n)),
        attributes_(mapped_attributes(tasks)),
        bad_(chunks_ * (tasks.size() + 1), 0) {}

  // SH that some primitives lack are stored last, because SH of degree 0 set them to 0.
  MapResult map() {
    map_tasks(false);
    if (std::any_of(tasks_.begin(), tasks_.end(), is_partial)) map_tasks(true);
    MapResult out;
    out.in_range.assign(tasks_.size(), true);
    const std::uint32_t sh = attributes_.floats_of_sh();
    out.renderable = sh == 0 || all_renderable(set_, 0, sh, 0, n_);
    for (std::size_t k = 0; k < bad_.size(); ++k) {
      const std::size_t t = k % (tasks_.size() + 1);
      if (bad_[k] == 0) continue;
      if (t == tasks_.size()) {
        out.renderable = false;
      } else {
        out.in_range[t] = false;
      }
    }
    return out;
  }

  // Returns the carries of the last chunk.
  std::span<const Carries> carries() const { return std::span(carries_).last(tasks_.size()); }

 private:
  // Returns whether some primitives have no values.
  static bool is_partial(const StreamTask& task) { return !task.members.empty(); }

  void map_tasks(bool partial) {
    if (chunks_ == 1) {
      map_chunk(0, partial);
    } else {
      parallel_for(std::size_t{0}, chunks_, [&](std::size_t chunk) { map_chunk(chunk, partial); });
    }
  }

  // Maps the values of a chunk of those tasks that are partial, or of the others.
  void map_chunk(std::size_t chunk, bool partial) {
    const std::size_t end = std::min(n_, (chunk + 1) * grain_);
    std::uint8_t* const found = bad_.data() + chunk * (tasks_.size() + 1);
    MapRun run;
    for (std::size_t first = chunk * grain_; first < end; first += kMapRun) {
      const std::size_t run_end = std::min(end, first + kMapRun);
      if (!partial && !set_.sh.empty()) {
        const auto stride = static_cast<std::size_t>(3 * set_.sh_coefficients());
        run.sh = set_.sh.data() + first * stride;
        run.sh_end = set_.sh.data() + run_end * stride;
      }
      for (std::size_t t = 0; t < tasks_.size(); ++t) {
        if (is_partial(tasks_[t]) != partial) continue;
        const std::size_t last = std::min(run_end, values_of(tasks_[t], n_));
        std::uint32_t* const carry = carries_[chunk * tasks_.size() + t].data();
        if (first < last && !map_task(tasks_[t], context_, first, last, carry, run, set_))
          found[t] = 1;
      }
      const std::uint32_t floats = attributes_.floats & ~attributes_.floats_of_sh();
      if (!partial && !all_renderable(set_, attributes_.all, floats, first, run_end))
        found[tasks_.size()] = 1;
    }
  }

  const std::span<const StreamTask> tasks_;
  const SegmentContext& context_;
  const std::size_t n_;
  Gaussians4D& set_;
  const std::size_t grain_, chunks_;
  std::vector<Carries> carries_;
  const MappedAttributes attributes_;
  // By chunk: a flag for each task that is out of range, and one if it is not renderable.
  std::vector<std::uint8_t> bad_;
};

}  // namespace

std::vector<Carries> first_carries(std::span<const StreamTask> tasks,
                                   const SegmentContext& context) {
  std::vector<Carries> out(tasks.size(), Carries{});
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    const auto prediction = static_cast<Prediction>(tasks[t].row->prediction);
    if (prediction == Prediction::kMorton) out[t][0] = context.first_key;
  }
  return out;
}

MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set, std::vector<Carries>& carries) {
  StreamMapper mapper(tasks, context, n, set, carries);
  MapResult out = mapper.map();
  carries.assign(mapper.carries().begin(), mapper.carries().end());
  return out;
}

MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set) {
  std::vector<Carries> carries = first_carries(tasks, context);
  return map_streams(tasks, context, n, set, carries);
}

}  // namespace stgs
