// SPDX-License-Identifier: Apache-2.0
#include "codec/planes.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "codec/draco_points.h"
#include "quantise/steps.h"

namespace stgs {
namespace {

constexpr std::size_t kSamples = 4096;    // per component, for choosing digits
constexpr std::size_t kSampleRun = 64;    // successive primitives in a sample
constexpr double kTableSymbolBits = 6.0;  // approximate cost of a table, per symbol in it
constexpr double kDigitBits = 0.1;        // cost of decoding one more digit, per value
// Digits per value, at most: no layout has more planes than its floats have bytes (spec 8.1). A key
// stands for three components, each of which may have two digits besides.
constexpr std::size_t kMaxValueDigits = 4, kMaxKeyDigits = 6;

// Returns the bits of each axis of the positions that are below their keys.
int low_bits_of(std::span<const Integers* const> records) {
  std::uint32_t all = 0;
  for (const Integers* record : records) {
    for (const std::uint32_t q : record->values) all |= q;
  }
  return std::max(0, static_cast<int>(std::bit_width(all)) - kKeyBits);
}

// Returns the key of position i (spec 8.4).
std::uint32_t key_of(const Integers& positions, std::size_t i, int low) {
  const std::size_t n = positions.size();
  const std::uint32_t* const q = positions.values.data() + i;
  return static_cast<std::uint32_t>(morton_key(q[0] >> low, q[n] >> low, q[2 * n] >> low));
}

// How the values of a component follow from integers: prediction, and what is subtracted first.
struct ValueRule {
  Prediction prediction = Prediction::kPlain;
  std::uint32_t minimum = 0;
  int low = 0;  // with kMorton
};

// Calls visit(i, v) for the values v of a component after prediction (spec 8.3, 8.4). With kMorton,
// component 0 is that of the keys.
template <typename Visit>
void each_value(const Integers& integers, const ValueRule& rule, std::size_t component,
                const Visit& visit) {
  const std::size_t n = integers.size();
  if (n == 0) return;
  const auto signed_value = [](std::uint32_t q) { return zigzag(static_cast<std::int32_t>(q)); };
  if (rule.prediction == Prediction::kMorton) {
    std::uint32_t before = key_of(integers, 0, rule.low);
    for (std::size_t i = 0; i < n; ++i) {
      const std::uint32_t key = key_of(integers, i, rule.low);
      visit(i, key - before);
      before = key;
    }
    return;
  }
  const std::uint32_t* const q = integers.values.data() + component * n;
  if (rule.prediction == Prediction::kPlain) {
    for (std::size_t i = 0; i < n; ++i) visit(i, q[i] - rule.minimum);
  } else if (rule.prediction == Prediction::kZigzag) {
    for (std::size_t i = 0; i < n; ++i) visit(i, signed_value(q[i] - rule.minimum));
  } else {
    visit(std::size_t{0}, signed_value(q[0] - rule.minimum));
    for (std::size_t i = 1; i < n; ++i) visit(i, signed_value(q[i] - q[i - 1]));
  }
}

// Bits of the values of a component over all records, and an even sample of the values.
struct Sample {
  int bits = 0;
  std::vector<std::uint32_t> values;
};

Sample sample_of(std::span<const Integers* const> records, std::size_t total, const ValueRule& rule,
                 std::size_t component) {
  const std::size_t stride = std::max<std::size_t>(1, total / kSamples) * kSampleRun;
  std::uint32_t all = 0;
  std::size_t at = 0;  // position in the stride
  Sample out;
  for (const Integers* record : records) {
    each_value(*record, rule, component, [&](std::size_t, std::uint32_t v) {
      all |= v;
      if (at < kSampleRun) out.values.push_back(v);
      if (++at == stride) at = 0;
    });
  }
  out.bits = static_cast<int>(std::bit_width(all));
  return out;
}

// Returns count * log2(count), for counts of a sample.
double sample_term(std::size_t count) {
  static const std::vector<double> terms = [] {
    std::vector<double> out(2 * (kSamples + kSampleRun));
    for (std::size_t i = 1; i < out.size(); ++i) {
      out[i] = static_cast<double>(i) * std::log2(static_cast<double>(i));
    }
    return out;
  }();
  return terms[count];
}

// Returns the bits of `total` digits distributed as in the sample, and of their table.
double digit_cost(const Sample& sample, int shift, int width, double total) {
  std::array<std::uint32_t, 256> counts{};
  const std::uint32_t mask = (1u << width) - 1;
  for (const std::uint32_t v : sample.values) ++counts[v >> shift & mask];
  const auto samples = static_cast<double>(sample.values.size());
  double bits = sample_term(sample.values.size());
  int used = 0;
  for (const std::uint32_t count : counts) {
    if (count == 0) continue;
    ++used;
    bits -= sample_term(count);
  }
  if (used < 2) return 0.0;
  // Approximate bias of the entropy of a sample.
  const double missing = 0.72 * (used - 1) * (1.0 - samples / total);
  return (bits + missing) / samples * total + kTableSymbolBits * used + kDigitBits * total;
}

struct Digits {
  double cost = std::numeric_limits<double>::infinity();  // bits of all values
  std::vector<std::uint8_t> widths;                       // lowest first
};

// Returns the digit widths with the lowest total cost over the components.
Digits best_digits(const std::vector<Sample>& samples, double total, int bits,
                   std::size_t max_digits) {
  const auto size = static_cast<std::size_t>(bits) + 1;
  std::vector<std::array<double, 9>> cost(size);
  const auto cost_of = [&](int shift, int width) {
    double sum = 0.0;
    for (const Sample& sample : samples) sum += digit_cost(sample, shift, width, total);
    return sum;
  };
  if (bits <= 8)
    return {cost_of(0, std::max(bits, 1)), {static_cast<std::uint8_t>(std::max(bits, 1))}};
  for (int shift = 0; shift < bits; ++shift) {
    for (int width = 1; width <= std::min(8, bits - shift); ++width) {
      cost[static_cast<std::size_t>(shift)][static_cast<std::size_t>(width)] =
          cost_of(shift, width);
    }
  }
  // best[k][b]: the cheapest split of the lowest b bits into k digits.
  std::vector<std::vector<Digits>> best(max_digits + 1, std::vector<Digits>(size));
  best[0][0].cost = 0.0;
  Digits out;
  for (std::size_t k = 1; k <= max_digits; ++k) {
    for (std::size_t b = 1; b < size; ++b) {
      for (std::size_t width = 1; width <= std::min<std::size_t>(8, b); ++width) {
        const Digits& before = best[k - 1][b - width];
        const double sum = before.cost + cost[b - width][width];
        if (sum >= best[k][b].cost) continue;
        best[k][b] = before;
        best[k][b].cost = sum;
        best[k][b].widths.push_back(static_cast<std::uint8_t>(width));
      }
    }
    if (best[k][size - 1].cost < out.cost) out = best[k][size - 1];
  }
  return out;
}

// Returns digits of 8 bits, for kBytes.
Digits byte_digits(const std::vector<Sample>& samples, double total, int bits) {
  Digits out{0.0,
             std::vector<std::uint8_t>(static_cast<std::size_t>(std::max(1, (bits + 7) / 8)), 8)};
  for (std::size_t d = 0; d < out.widths.size(); ++d) {
    for (const Sample& sample : samples) {
      out.cost += digit_cost(sample, static_cast<int>(8 * d), 8, total);
    }
  }
  return out;
}

bool has_origin(Mapping mapping) {
  return mapping == Mapping::kLinear || mapping == Mapping::kTruncated || mapping == Mapping::kTime;
}

// Returns the minimum of each component if the mapping has an origin; else 0.
std::vector<std::uint32_t> minimum_of(std::span<const Integers* const> records) {
  const Integers& first = *records.front();
  std::vector<std::uint32_t> minimum(static_cast<std::size_t>(first.components), 0);
  if (first.morton || !has_origin(first.mapping)) return minimum;
  for (std::size_t c = 0; c < minimum.size(); ++c) {
    auto smallest = std::numeric_limits<std::int32_t>::max();
    for (const Integers* record : records) {
      const std::size_t n = record->size();
      for (std::size_t i = 0; i < n; ++i) {
        smallest = std::min(smallest, static_cast<std::int32_t>(record->values[c * n + i]));
      }
    }
    minimum[c] = static_cast<std::uint32_t>(smallest);
  }
  if (first.attribute == Attribute::kLogScale) {  // one origin (spec 8.8)
    const auto by_value = [](std::uint32_t a, std::uint32_t b) {
      return static_cast<std::int32_t>(a) < static_cast<std::int32_t>(b);
    };
    std::fill(minimum.begin(), minimum.end(),
              *std::min_element(minimum.begin(), minimum.end(), by_value));
  }
  return minimum;
}

void set_origin(const Integers& integers, StreamPlan& plan) {
  std::copy_n(integers.origin, 3, plan.row.origin);
  if (integers.morton || !has_origin(integers.mapping)) return;
  if (integers.mapping == Mapping::kTruncated) {
    plan.row.origin[0] = from_truncated(static_cast<std::int32_t>(plan.minimum[0]), integers.step);
    return;
  }
  for (std::size_t c = 0; c < plan.minimum.size(); ++c) {
    plan.row.origin[c] =
        static_cast<float>(size_of(integers.step) * static_cast<std::int32_t>(plan.minimum[c]));
  }
}

std::vector<Prediction> predictions_of(std::span<const Integers* const> records,
                                       const std::vector<std::uint32_t>& minimum, bool morton) {
  const Integers& first = *records.front();
  if (morton) return {Prediction::kMorton};
  if (first.mapping == Mapping::kInteger) return {Prediction::kPlain};
  bool negative = false;
  for (const Integers* record : records) {
    const std::size_t n = record->size();
    for (std::size_t i = 0; i < record->values.size() && !negative; ++i) {
      negative = (record->values[i] - minimum[i / n]) >> 31 != 0;
    }
  }
  return {negative ? Prediction::kZigzag : Prediction::kPlain, Prediction::kDelta};
}

}  // namespace

StreamPlan plan_floats(Attribute attribute) {
  StreamPlan plan;
  if (attribute == Attribute::kShDegree) {
    plan.row.attribute = static_cast<std::uint16_t>(attribute);
    plan.row.mapping = static_cast<std::uint8_t>(Mapping::kInteger);
    plan.row.components = plan.row.digits = 1;
    plan.row.digit_bits[0] = 8;
    plan.minimum.resize(1, 0);
    return plan;
  }
  plan.row.attribute = static_cast<std::uint16_t>(attribute);
  plan.row.components = static_cast<std::uint8_t>(components_of(attribute));
  plan.row.digits = sizeof(float);
  std::fill_n(plan.row.digit_bits.begin(), sizeof(float), std::uint8_t{8});
  plan.minimum.resize(plan.row.components, 0);
  return plan;
}

StreamPlan plan_draco(const Integers& positions) {
  StreamPlan plan;
  plan.row.attribute = static_cast<std::uint16_t>(positions.attribute);
  plan.row.components = kDracoComponents;
  plan.row.mapping = static_cast<std::uint8_t>(positions.mapping);
  plan.row.coder = static_cast<std::uint8_t>(Coder::kDraco);
  plan.row.step = positions.step;
  plan.row.digits = kDracoDigits;
  std::fill_n(plan.row.digit_bits.begin(), kDracoDigits, std::uint8_t{8});
  std::copy_n(positions.origin, 3, plan.row.origin);
  plan.minimum.resize(kDracoComponents, 0);
  return plan;
}

StreamPlan plan_stream(std::span<const Integers* const> records, Coder coder) {
  const Integers& first = *records.front();
  StreamPlan plan;
  plan.minimum = minimum_of(records);
  plan.row.attribute = static_cast<std::uint16_t>(first.attribute);
  const int low = first.morton ? low_bits_of(records) : 0;
  // Planes of bytes have digits of 8 bits, also those of the low bits (spec 8.1).
  const int stored_low = coder == Coder::kRans || low == 0 ? low : std::max(low, 8);
  const bool morton = first.morton && (coder == Coder::kRans || stored_low <= 8);
  plan.row.components = static_cast<std::uint8_t>(morton ? 1 : first.components);
  plan.row.low = static_cast<std::uint8_t>(morton ? stored_low : 0);
  plan.row.mapping = static_cast<std::uint8_t>(first.mapping);
  plan.row.step = first.step;
  set_origin(first, plan);
  std::size_t total = 0;
  for (const Integers* record : records) total += record->size();
  Digits best;
  for (const Prediction prediction : predictions_of(records, plan.minimum, morton)) {
    std::vector<Sample> samples;
    int bits = 0;
    for (std::size_t c = 0; c < plan.row.components; ++c) {
      samples.push_back(sample_of(records, total, {prediction, plan.minimum[c], plan.row.low}, c));
      bits = std::max(bits, samples.back().bits);
    }
    const auto values = static_cast<double>(total);
    const std::size_t max_digits = morton ? kMaxKeyDigits : kMaxValueDigits;
    Digits digits = coder == Coder::kRans ? best_digits(samples, values, bits, max_digits)
                                          : byte_digits(samples, values, bits);
    const std::uint64_t raw_bits = 8 * ((bits + 7) / 8) * samples.size() * total;
    const auto raw = static_cast<double>(raw_bits);
    Coder chosen = coder;
    if (coder == Coder::kRans && digits.cost > raw) {  // too few primitives to pay for tables
      digits = byte_digits(samples, values, bits);
      digits.cost = raw;
      chosen = Coder::kBytes;
    }
    if (digits.cost >= best.cost) continue;
    best = std::move(digits);
    plan.row.coder = static_cast<std::uint8_t>(chosen);
    plan.row.prediction = static_cast<std::uint8_t>(prediction);
  }
  if (plan.row.coder != static_cast<std::uint8_t>(coder) && plan.row.low % 8 != 0)
    return plan_stream(records, Coder::kBytes);
  plan.row.digits = static_cast<std::uint8_t>(best.widths.size());
  std::copy(best.widths.begin(), best.widths.end(), plan.row.digit_bits.begin());
  return plan;
}

std::uint32_t first_key_of(const Integers& positions, const StreamPlan& plan) {
  return key_of(positions, 0, plan.row.low);
}

void append_planes(const Integers& integers, const StreamPlan& plan,
                   std::vector<std::uint8_t>& planes) {
  const std::size_t n = integers.size();
  const auto prediction = static_cast<Prediction>(plan.row.prediction);
  std::vector<std::uint32_t> values(n);
  const auto append_digit = [&](int shift, std::uint32_t mask) {
    const std::size_t at = planes.size();
    planes.resize(at + n);
    for (std::size_t i = 0; i < n; ++i)
      planes[at + i] = static_cast<std::uint8_t>(values[i] >> shift & mask);
  };
  for (std::size_t c = 0; c < plan.row.components; ++c) {
    each_value(integers, {prediction, plan.minimum[c], plan.row.low}, c,
               [&](std::size_t i, std::uint32_t v) { values[i] = v; });
    int shift = 0;
    for (std::size_t d = 0; d < plan.row.digits; shift += plan.row.digit_bits[d++])
      append_digit(shift, (1u << plan.row.digit_bits[d]) - 1);
  }
  for (std::size_t c = 0; plan.row.low > 0 && c < 3; ++c) {
    const std::uint32_t mask = (1u << plan.row.low) - 1;
    for (std::size_t i = 0; i < n; ++i) values[i] = integers.values[c * n + i] & mask;
    for (std::size_t d = 0; d < plan.row.low_digits(); ++d)
      append_digit(static_cast<int>(8 * d), 0xFF);
  }
}

}  // namespace stgs
