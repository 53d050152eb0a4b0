// SPDX-License-Identifier: Apache-2.0
// Data shared by the records of a file (spec 6.1): layouts, which describe the streams of a kind of
// record, and the rANS tables of their planes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "codec/rans.h"
#include "codec/stream.h"

namespace stgs {

inline constexpr std::size_t kMaxTables = 1024;
inline constexpr std::size_t kMaxOwnTables = 256;  // of a record's own layout
// Memory charged for a table with its lookup (conformance 1.5).
inline constexpr std::uint64_t kTableMemory = sizeof(RansLookup);
// Memory charged for each layout and each row, and the number of them free of charge (conformance
// 1.5).
inline constexpr std::uint64_t kRowMemory = 128, kFreeRows = 1024;
inline constexpr std::size_t kMaxLayouts = 65534;
inline constexpr std::uint16_t kOwnLayout = 0xFFFF;  // the record contains its layout

struct LayoutSet;

struct Layout {
  std::vector<StreamRow> streams;
  // Set if a row violates a rule (spec 6.3). Records with this layout cannot be read.
  int problem = 0;  // issue number; 0: none
  std::uint64_t problem_at = 0;
  std::string why;

  // Rows whose planes are stored together: a group, or a single stream that is not rANS.
  struct Unit {
    std::size_t first = 0, count = 0;
  };
  std::vector<Unit> units() const;  // in the order of the rows (spec 6.5)
  // Returns the number of planes of all streams.
  std::size_t planes() const;
  // Returns whether a stream has prediction kMorton.
  bool has_first_key() const;
  // Returns whether a stream is sh_degree.
  bool has_sh_degree() const;
  // Returns the number of planes of a row that take bytes. A plane whose table has a single symbol
  // takes none.
  static std::size_t varying_planes(const StreamRow& row, const LayoutSet& set);
  bool operator==(const Layout&) const = default;
};

struct LayoutSet {
  std::vector<RansTable> tables;
  std::vector<Layout> layouts;
  // By table: its only symbol, or -1; and its lookup, set by make_lookups() for the head's layouts
  // if a plane refers to it and it has several. There are none beyond the last such table.
  std::vector<std::int16_t> only;
  std::vector<RansLookup> lookups;
  // Layouts and rows together, set by parse_layouts().
  std::uint64_t entries = 0;
};

// Returns the only symbol of a table, or -1 if it has several.
std::int16_t only_symbol(const RansTable& table);

void write_layouts(const LayoutSet& set, ByteWriter& out);
// Reads a set of at most `max_tables` tables and `max_layouts` layouts from `in`, which starts at
// byte `offset` of the file. `memory`: bytes that the tables may take. The problem of a row is
// stored in its layout.
bool parse_layouts(ByteReader& in, std::uint64_t offset, std::size_t max_tables,
                   std::size_t max_layouts, std::uint64_t memory, LayoutSet& set,
                   Findings& findings);
// Marks, by table, those with several symbols to which planes of a row refer. Extends `used` to the
// last of them.
void mark_tables(const LayoutSet& set, const StreamRow& row, std::vector<bool>& used);
// Makes the lookups of the tables that planes refer to. They cost far more than the bytes of a
// table, so check the layouts first.
void make_lookups(LayoutSet& set);

}  // namespace stgs
