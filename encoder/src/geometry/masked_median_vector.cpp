// SPDX-License-Identifier: Apache-2.0
#include "geometry/masked_median.h"

#include <algorithm>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/masked_median_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
constexpr std::size_t kMedianLanes = 64;
using ByteTag = hn::CappedTag<std::uint8_t, kMedianLanes>;

// The samples at the positions of one vector.
struct Samples {
  HWY_ALIGN std::uint8_t rows[kMaxMedianSamples][kMedianLanes];
};

// Sorts the values of each lane over the first n rows, by Batcher's merge exchange (Knuth, The Art
// of Computer Programming, 5.2.2, algorithm M).
void sort_rows(Samples& samples, std::size_t n) {
  const ByteTag d;
  std::size_t top = 1;
  while (2 * top < n) top *= 2;
  for (std::size_t p = top; p > 0; p /= 2) {
    std::size_t q = top, r = 0, distance = p;
    for (;;) {
      for (std::size_t i = 0; i + distance < n; ++i) {
        if ((i & p) != r) continue;
        const auto a = hn::Load(d, samples.rows[i]), b = hn::Load(d, samples.rows[i + distance]);
        hn::Store(hn::Min(a, b), d, samples.rows[i]);
        hn::Store(hn::Max(a, b), d, samples.rows[i + distance]);
      }
      if (q == p) break;
      distance = q - p;
      q /= 2;
      r = p;
    }
  }
}

// Loads the samples at `at`, masked ones as 255, which sort last. Returns how many are not masked.
hn::Vec<ByteTag> load_rows(const std::vector<const std::uint8_t*>& samples,
                           const std::vector<const std::uint8_t*>& masks, std::size_t at,
                           std::size_t length, Samples& out) {
  const ByteTag d;
  HWY_ALIGN std::uint8_t mask[kMedianLanes] = {};
  auto counts = hn::Zero(d);
  for (std::size_t s = 0; s < samples.size(); ++s) {
    std::memcpy(out.rows[s], samples[s] + at, length);
    auto masked = hn::Zero(d);
    if (masks[s] != nullptr) {
      std::memcpy(mask, masks[s] + at, length);
      masked = hn::Load(d, mask);
      hn::Store(hn::Or(hn::Load(d, out.rows[s]), masked), d, out.rows[s]);
    }
    counts = hn::Add(counts, hn::AndNot(masked, hn::Set(d, 1)));
  }
  return counts;
}

void medians_of(const std::vector<const std::uint8_t*>& samples,
                const std::vector<const std::uint8_t*>& masks, std::size_t count,
                std::uint8_t* medians, std::uint8_t* counts) {
  const ByteTag d;
  Samples rows{};
  HWY_ALIGN std::uint8_t result[kMedianLanes];
  for (std::size_t at = 0; at < count; at += hn::Lanes(d)) {
    const std::size_t length = std::min(hn::Lanes(d), count - at);
    const auto counted = load_rows(samples, masks, at, length, rows);
    sort_rows(rows, samples.size());
    auto median = hn::Zero(d);
    for (std::size_t n = 1; n <= samples.size(); ++n) {
      const auto has_n = hn::Eq(counted, hn::Set(d, static_cast<std::uint8_t>(n)));
      median = hn::IfThenElse(has_n, hn::Load(d, rows.rows[n / 2]), median);
    }
    hn::Store(median, d, result);
    std::memcpy(medians + at, result, length);
    hn::Store(counted, d, result);
    std::memcpy(counts + at, result, length);
  }
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(medians_of);

void masked_median(const std::vector<const std::uint8_t*>& samples,
                   const std::vector<const std::uint8_t*>& masks, std::size_t count,
                   std::uint8_t* medians, std::uint8_t* counts) {
  HWY_DYNAMIC_DISPATCH(medians_of)(samples, masks, count, medians, counts);
}

}  // namespace stgs::encoder::geometry
#endif
