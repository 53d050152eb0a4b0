// SPDX-License-Identifier: Apache-2.0
// Interprets an input as the choices of a program that calls an interface.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "fuzz_target.h"

namespace stgs::fuzz {

// Returns the input byte by byte, and zeros after its end.
class Choices {
 public:
  explicit Choices(View bytes) : bytes_(bytes) {}
  bool has_more() const { return position_ < bytes_.size(); }
  std::uint8_t next() { return position_ < bytes_.size() ? bytes_[position_++] : std::uint8_t{0}; }
  template <typename T, std::size_t kCount>
  const T& pick(const T (&values)[kCount]) {
    return values[next() % kCount];
  }
  // Numbers that interfaces mishandle.
  double number() {
    constexpr double kNumbers[] = {0,
                                   1,
                                   -1,
                                   0.5,
                                   1e-6,
                                   1e-30,
                                   3600,
                                   3e9,
                                   1e300,
                                   HUGE_VAL,
                                   std::numeric_limits<double>::quiet_NaN(),
                                   100,
                                   1e-308,
                                   0.3,
                                   -1e9,
                                   87};
    return pick(kNumbers);
  }
  std::uint32_t count() {
    constexpr std::uint32_t kCounts[] = {0, 1, 2, 300, 1024, 100'000'001, UINT32_MAX};
    return pick(kCounts);
  }
  std::int32_t small_int() { return static_cast<std::int8_t>(next()) / 8; }

 private:
  View bytes_;
  std::size_t position_ = 0;
};

// A copy of a struct with another struct_size, in memory of exactly that size, as a program built
// against another version of the header passes it.
template <typename T>
class ResizedStruct {
 public:
  ResizedStruct(const T& value, std::uint8_t size) : words_(2 + size % (sizeof(T) / 8 + 4)) {
    std::memcpy(words_.data(), &value, std::min(8 * words_.size(), sizeof value));
    words_[0] = 8 * words_.size();
  }
  T* get() { return reinterpret_cast<T*>(words_.data()); }

 private:
  std::vector<std::uint64_t> words_;
};

}  // namespace stgs::fuzz
