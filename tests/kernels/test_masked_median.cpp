// SPDX-License-Identifier: Apache-2.0
// The vectorised median of bytes against a sort.
#include "geometry/masked_median.h"

#include <algorithm>
#include <random>

#include "catch.h"
#include "vector_targets.h"

using namespace stgs::encoder::geometry;

namespace {

using Bytes = std::vector<std::uint8_t>;

struct Medians {
  Bytes medians, counts;
  bool operator==(const Medians&) const = default;
};

std::vector<const std::uint8_t*> pointers(const std::vector<Bytes>& arrays) {
  std::vector<const std::uint8_t*> out;
  for (const Bytes& array : arrays) out.push_back(array.empty() ? nullptr : array.data());
  return out;
}

Medians sorted_medians(const std::vector<Bytes>& samples, const std::vector<Bytes>& masks) {
  Medians out;
  for (std::size_t i = 0; i < samples[0].size(); ++i) {
    Bytes values;
    for (std::size_t s = 0; s < samples.size(); ++s)
      if (masks[s].empty() || masks[s][i] == 0) values.push_back(samples[s][i]);
    std::sort(values.begin(), values.end());
    out.medians.push_back(values.empty() ? 0 : values[values.size() / 2]);
    out.counts.push_back(static_cast<std::uint8_t>(values.size()));
  }
  return out;
}

}  // namespace

TEST_CASE("the median of bytes that are not masked is that of a sort") {
  std::mt19937 random(7);
  for (const std::size_t count : {1u, 63u, 64u, 200u}) {
    for (const std::size_t n : {1u, 2u, 3u, 8u, 25u, 32u}) {
      std::vector<Bytes> samples(n, Bytes(count)), masks(n, Bytes(count));
      for (std::size_t s = 0; s < n; ++s) {
        for (std::uint8_t& value : samples[s]) value = static_cast<std::uint8_t>(random());
        for (std::uint8_t& mask : masks[s]) mask = random() % 3 == 0 ? 255 : 0;
        if (s % 4 == 1) masks[s].clear();
      }
      if (!masks[0].empty()) masks[0][0] = 255;
      const Medians expected = sorted_medians(samples, masks);
      stgs::testing::for_each_vector_target([&] {
        Medians found{Bytes(count), Bytes(count)};
        masked_median(pointers(samples), pointers(masks), count, found.medians.data(),
                      found.counts.data());
        CHECK(found == expected);
      });
    }
  }
}
