// SPDX-License-Identifier: Apache-2.0
// The integers of a stream, and the numbers that they stand for, with scalar code (spec 8).
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "codec/stream.h"

namespace stgs::testing {

// Parameters of a segment that its streams depend on.
struct SegmentNumbers {
  std::int64_t part_units = 0;   // length of the part, units of 2^-20 ticks
  std::int64_t start_units = 0;  // beginning of the segment, units of 2^-21 ticks
  std::uint32_t first_key = 0;
};

// A stream after spec 8.4, with what its mapping derives from it.
struct StreamIntegers {
  const StreamRow* row = nullptr;            // not owned
  std::vector<std::vector<std::int64_t>> q;  // by component; the bits of floats with kFloat
  std::vector<int> exponents;                // of each primitive's step, mappings 3 and 6
  std::string first = "0";                   // F in decimal, mapping 7
  std::vector<std::vector<double>> numbers;  // of spec 8.5, by component
};
// By attribute.
using RecordIntegers = std::map<Attribute, StreamIntegers>;

// Computes those of a stream of n values. `before`: of the streams of lower attributes.
StreamIntegers integers_of(const StreamRow& row, const Plane* planes, std::size_t n,
                           const SegmentNumbers& segment, const RecordIntegers& before);

}  // namespace stgs::testing
