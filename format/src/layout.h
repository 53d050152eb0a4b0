// SPDX-License-Identifier: Apache-2.0
// What the records of a file have in common (spec 6.2): layouts, the streams of a kind of record,
// and the tables that their planes are coded with.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rans.h"
#include "stream.h"

namespace stgs {

inline constexpr std::size_t kMaxTables = 1024;
inline constexpr std::size_t kMaxOwnTables = 256;  // of a record's own layout
// What a table takes once it can be looked up (conformance 1.5).
inline constexpr std::uint64_t kTableMemory = sizeof(RansLookup);
// What each row of layouts counts of the limit of memory, and how many do not (conformance 1.5).
inline constexpr std::uint64_t kRowMemory = 128, kFreeRows = 1024;
inline constexpr std::size_t kMaxLayouts = 65534;
inline constexpr std::uint16_t kOwnLayout = 0xFFFF;  // a record has its layout in itself

struct LayoutSet;

struct Layout {
  std::vector<StreamRow> streams;
  // Where a row breaks a rule (spec 6.3): the records that name the layout cannot be read.
  int problem = 0;  // issue number; 0: none
  std::uint64_t problem_at = 0;
  std::string why;

  bool has_group() const;      // a stream is coded with rANS
  std::size_t planes() const;  // of the streams that are not skipped
  bool has_first_key() const;  // a stream has prediction kMorton
  // Those that are decoded: a table of one symbol knows its own without any bytes.
  std::size_t varying_planes(const LayoutSet& set) const;
  bool operator==(const Layout&) const = default;
};

struct LayoutSet {
  std::vector<RansTable> tables;
  std::vector<Layout> layouts;
  // What parse_layouts adds: a table's only symbol, or -1, and the slots of the others.
  std::vector<std::int16_t> only;
  std::vector<RansLookup> lookups;
};

// A table's only symbol, or -1 where it has several.
std::int16_t only_symbol(const RansTable& table);

void write_layouts(const LayoutSet& set, ByteWriter& out);
// Takes a set of at most `most_tables` tables from `in`, whose first byte is byte `offset` of the
// file. `memory`: bytes that its tables may take. What is wrong with a row stands in its layout.
bool parse_layouts(ByteReader& in, std::uint64_t offset, std::size_t most_tables,
                   std::uint64_t memory, LayoutSet& set, Findings& findings);

}  // namespace stgs
