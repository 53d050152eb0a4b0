// SPDX-License-Identifier: Apache-2.0
// When static primitives join the persistent set.
#include "train/set_growth.h"

#include <numeric>

#include "catch.h"

using namespace stgs::encoder;

namespace {

using Indices = std::vector<std::uint32_t>;

Indices first(std::size_t count) {
  Indices out(count);
  std::iota(out.begin(), out.end(), 0u);
  return out;
}

constexpr RecordedSpan kEarly = {10, 12}, kLate = {89, 91}, kBetween = {92, 94};

}  // namespace

TEST_CASE("static content of the first window joins, and later content once there is enough") {
  CHECK(choose_joining(first(7), 0, {}, {0, 2}) == first(7));
  CHECK(choose_joining(first(20), 1000, {}, kEarly) == first(20));
  CHECK(choose_joining(first(19), 1000, {}, kEarly).empty());
}

TEST_CASE("a settled set takes the most important primitives") {
  std::vector<float> importance(50, 1.0f);
  importance[30] = 3.0f;
  importance[40] = 2.0f;
  CHECK(choose_joining(first(50), 1000, importance, kBetween).empty());
  const Indices joining = choose_joining(first(50), 1000, importance, kLate);
  CHECK(joining == Indices{0, 1, 2, 3, 4, 5, 6, 7, 30, 40});
  CHECK(choose_joining({4, 9}, 1000, importance, kLate) == Indices{4, 9});
  CHECK(choose_joining(first(50), 1000, {}, kLate) == first(10));
}

TEST_CASE("a still scene grows by at most two percent per minute") {
  std::size_t size = 1000;
  std::vector<std::size_t> sizes;
  for (int window = 0; window < 300; ++window) {
    const RecordedSpan span{2.0 * window, 2.0 * (window + 1)};
    size += choose_joining(first(60), size, {}, span).size();
    if (window % 30 == 29) sizes.push_back(size);
  }
  for (std::size_t minute = 1; minute < sizes.size(); ++minute)
    CHECK(static_cast<double>(sizes[minute]) <= 1.0202 * static_cast<double>(sizes[minute - 1]));
}

TEST_CASE("the content of a scene that has changed joins at once") {
  CHECK(choose_joining(first(101), 1000, {}, kBetween) == first(101));
}
