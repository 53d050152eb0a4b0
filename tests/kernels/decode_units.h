// SPDX-License-Identifier: Apache-2.0
// The units of a record as spec/shaders/decode.comp takes them, and a scalar decoder of the
// integers q (spec 8.1 to 8.4) to compare with.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "codec/rans.h"
#include "stgs/format/coded_segment.h"

namespace stgs::testing {

// The integers of a stream: one component after the other, one for each of its symbols.
using StreamIntegers = std::vector<std::uint32_t>;

// As in decode.comp.
struct ShaderUnit {
  std::uint32_t offset = 0, size = 0, coder = 0, symbols = 0;
  std::uint32_t plane = 0, planes = 0, stream = 0, streams = 0;
};
struct ShaderStream {
  std::uint32_t at = 0, components = 0, prediction = 0, low = 0, first_key = 0, digits = 0;
  std::uint32_t bits[kMaxDigits] = {};
};

// A unit of a record. The pointers belong to the record.
struct RecordUnit {
  const CodedGroup* group = nullptr;  // null: stored planes, or constant planes alone
  std::vector<const CodedStream*> streams;
  std::vector<std::uint8_t> bytes;
};
// Returns the units of a record. A stream of constant planes alone, of which a coded record does
// not state the unit, has one of its own.
std::vector<RecordUnit> units_of(const CodedRecord& record);

// The contents of the shader's buffers, for units of one or several records.
class ShaderBuffers {
 public:
  // Adds a unit of a record with these lookups.
  void add(const RecordUnit& unit, std::span<const RansLookup> lookups, std::uint32_t first_key);

  std::vector<std::uint8_t> bytes = {0xFF};  // units may begin at any byte
  std::vector<RansLookup> lookups;
  std::vector<ShaderUnit> units;
  std::vector<ShaderStream> streams;
  std::vector<std::uint32_t> tables;
  std::uint32_t integers = 0;  // size of q

 private:
  std::uint32_t table(const RansLookup& lookup);

  std::map<RansLookup, std::uint32_t> numbers_;
};

// Returns the integers of each stream of a unit from the planes of the project's decoder; none if
// it rejects the group, or a key of 2^30 or more.
std::vector<StreamIntegers> scalar_integers(const RecordUnit& unit, const CodedRecord& record,
                                            std::span<const RansLookup> lookups,
                                            std::uint32_t first_key);

}  // namespace stgs::testing
