// SPDX-License-Identifier: Apache-2.0
// Decoding the units of a record to planes (spec 6.5, 7).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "codec/rans.h"
#include "codec/sh_members.h"
#include "codec/stream.h"
#include "container/segment.h"

namespace stgs {

// Decoded rows of a layout.
struct DecodedRows {
  std::size_t first = 0;                       // the first of them
  std::unique_ptr<std::uint8_t[]> symbols;     // of the planes that are not constant, in order
  std::vector<std::span<std::uint8_t>> areas;  // by row: its planes in `symbols`
  std::vector<std::vector<Plane>> planes;      // by row
  ShMembers members;                           // if sh_degree is among the rows
};

// Decodes the units of one record. Everything passed to the constructor must outlive it.
class RecordDecoder {
 public:
  RecordDecoder(const SegmentRecord& record, const FileHead& head, std::uint32_t ordinal,
                Findings& findings);

  // Checks that the bytes can contain the planes. Call it for all records of a segment before
  // allocating memory for its primitives.
  bool open();
  // Decodes the units of these attributes. Call it once, after open().
  bool decode(AttributeBits attributes, DecodedRows& out);
  // Adds the decoded streams to map. `rows` must outlive them.
  void add_tasks(AttributeBits attributes, const DecodedRows& rows,
                 std::vector<StreamTask>& tasks) const;
  // Converts the record for a decoder on another device. Call it once, after open(), instead of
  // decode().
  bool code(CodedRecord& out);

 private:
  std::uint32_t symbols_of(const StreamRow& row) const;
  // Returns the number of planes that are coded in a unit.
  std::size_t coded_planes(Layout::Unit unit) const;
  bool open_unit(std::size_t u);
  bool is_needed(Layout::Unit unit, AttributeBits attributes) const;
  DecodedRows assign_rows(std::size_t first, std::size_t count, AttributeBits attributes) const;
  // Returns the planes of a group, decoded to these rows.
  std::vector<RansPlaneTask> tasks_of(std::size_t u, DecodedRows& rows) const;
  // Decodes units [first, last).
  bool decode_units(std::size_t first, std::size_t last, AttributeBits attributes,
                    DecodedRows& rows);
  bool decode_groups_of(std::span<const std::size_t> units, DecodedRows& rows);
  bool decode_stored(std::size_t u, DecodedRows& rows);
  bool find_members(DecodedRows& rows);
  // Decodes the rows of the unit of sh_degree, if there is one.
  bool decode_degrees(ShMembers& members);
  CodedStream coded_stream(const StreamRow& row, const ShMembers& members) const;
  bool corrupt(std::size_t row, const char* problem) const;

  const SegmentRecord& record_;
  const LayoutSet& set_;
  const Layout& layout_;
  std::uint32_t ordinal_, n_;
  int sh_degree_;
  Findings& findings_;
  std::vector<std::optional<RansGroupDecoder>> groups_;  // by unit
};

}  // namespace stgs
