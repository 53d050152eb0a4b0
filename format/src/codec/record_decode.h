// SPDX-License-Identifier: Apache-2.0
// Decoding the units of a record to planes (spec 6.5, 7).
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "codec/rans.h"
#include "codec/sh_members.h"
#include "codec/stream.h"
#include "container/segment.h"

namespace stgs {

// Symbols to decode: [begin, end) of the planes of these attributes, as far as they have so many.
// `begin` and `end` are multiples of kRansBlock, unless there are no symbols from `end` on.
struct DecodeRange {
  AttributeBits attributes = kAllAttributes;
  std::size_t begin = 0, end = std::numeric_limits<std::size_t>::max();
};

// Decoded rows of a layout.
struct DecodedRows {
  std::size_t first = 0;                    // the first of them
  std::unique_ptr<std::uint8_t[]> symbols;  // of the planes of groups that are not constant
  std::size_t capacity = 0;                 // of `symbols`
  std::vector<std::uint8_t*> areas;         // by row of a group: its planes in `symbols`
  std::vector<std::vector<Plane>> planes;   // by row
  ShMembers members;                        // set by decode() if sh_degree is among the rows

  // Moves the beginning of all planes by `count` symbols.
  void skip(std::size_t count);
};

// Decodes the units of one record. Everything passed to the constructor must outlive it, and it
// must outlive the rows.
class RecordDecoder {
 public:
  RecordDecoder(const SegmentRecord& record, const FileHead& head, std::uint32_t ordinal,
                Findings& findings);

  // Checks that the bytes can contain the planes. Call it for all records of a segment before
  // allocating memory for its primitives.
  bool open();
  // Decodes the units of these attributes, and finds the members of SH. Call it once, after open().
  bool decode(AttributeBits attributes, DecodedRows& out);
  // Decodes a range. Call it after open(), instead of decode(), in ascending order of the ranges of
  // an attribute. Uses the memory of `out` again.
  bool decode_range(const DecodeRange& range, DecodedRows& out);
  // Adds the decoded streams to map. `rows` must outlive them.
  void add_tasks(AttributeBits attributes, const DecodedRows& rows,
                 std::vector<StreamTask>& tasks) const;
  // Returns the symbols of each plane of an attribute: of those above sh0, the primitives that have
  // values. 0 if the record lacks the attribute.
  std::uint32_t symbols_of(Attribute attribute) const;
  // Returns the bytes of the decoded symbols of these attributes, per value.
  std::size_t symbol_bytes(AttributeBits attributes) const;
  // Returns the planes of a row in `rows`.
  std::span<const Plane> planes_of(const StreamRow& row, const DecodedRows& rows) const {
    return rows.planes[static_cast<std::size_t>(&row - layout_.streams.data()) - rows.first];
  }
  // Returns the row of sh_degree, or null.
  const StreamRow* degree_row() const;
  // Checks the greatest SH degree of all primitives, and the numbers of primitives with a degree of
  // at least 1, 2 and 3.
  bool check_degrees(std::uint32_t greatest, const std::array<std::size_t, kShBands>& counts) const;
  // Converts the record for a decoder on another device. Call it once, after open(), instead of
  // decode().
  bool code(CodedRecord& out);

 private:
  std::uint32_t symbols_of(const StreamRow& row) const;
  // Returns the number of planes that are coded in a unit.
  std::size_t coded_planes(Layout::Unit unit) const;
  bool open_unit(std::size_t u);
  bool is_needed(Layout::Unit unit, AttributeBits attributes) const;
  // Returns the symbols of each plane of a row that are in a range.
  std::size_t count_in(const DecodeRange& range, const StreamRow& row) const;
  // Sets the planes of `count` rows from `first` on.
  void assign_rows(std::size_t first, std::size_t count, const DecodeRange& range,
                   DecodedRows& out) const;
  // Returns the planes of a group, decoded to these rows.
  std::vector<RansPlaneTask> tasks_of(std::size_t u, const DecodeRange& range,
                                      const DecodedRows& rows) const;
  // Decodes units [first, last).
  bool decode_units(std::size_t first, std::size_t last, const DecodeRange& range,
                    DecodedRows& rows);
  bool decode_groups_of(std::span<const std::size_t> units, const DecodeRange& range,
                        const DecodedRows& rows);
  // Decodes the positions that Draco codes, unless that is done.
  bool decode_points(std::size_t u);
  bool find_members(DecodedRows& rows);
  // Decodes the rows of the unit of sh_degree, if there is one.
  bool decode_degrees(ShMembers& members);
  CodedStream coded_stream(const StreamRow& row, const ShMembers& members) const;
  // Returns whether a group has so few symbols that the lookup of a plane is made when the plane is
  // decoded, in a single place of memory.
  bool is_short(std::size_t u) const;
  // Returns the tables that the groups need, by number: all, or those of groups that are not short.
  std::vector<bool> own_tables(bool all) const;
  // Makes the lookups of an own layout, unless that is done.
  void make_own_lookups();
  const RansLookup& lookup_of(std::uint16_t table) const {
    return record_.has_own ? own_lookups_[table] : set_.lookups[table];
  }
  bool corrupt(std::size_t row, const char* problem) const;

  const SegmentRecord& record_;
  const LayoutSet& set_;
  const Layout& layout_;
  std::uint32_t ordinal_, n_;
  int sh_degree_;
  Findings& findings_;
  std::vector<std::optional<RansGroupDecoder>> groups_;  // by unit
  std::vector<std::uint8_t> points_;                     // planes of positions that Draco codes
  std::unique_ptr<RansLookup[]> own_lookups_;            // by table of the record's own layout
};

}  // namespace stgs
