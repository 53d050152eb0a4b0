// SPDX-License-Identifier: Apache-2.0
// Layouts, the tables of the entropy coder, and the storage of planes (clauses 6.2 to 7.3, annex
// A).
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "core/bytes.h"
#include "interchange/import_memory.h"
#include "stgs/format/status.h"

namespace stgs::stgs1 {

using Bytes = std::vector<std::uint8_t>;
using View = std::span<const std::uint8_t>;

inline constexpr std::uint32_t kTableTotal = 4096;      // A.2
inline constexpr std::uint64_t kTableMemory = 16384;    // charged per table, conformance 1.5
inline constexpr std::uint16_t kOptionalFrom = 0x8000;  // attributes that readers skip, 6.5
inline constexpr int kMaxComponents = 21;

// The attributes (6.4).
enum : std::uint16_t { kPosition = 1, kTime, kSigma, kRadius, kVelocity, kLogScale, kRotation };
enum : std::uint16_t { kOpacity = 8, kSh0, kSh1, kSh2, kSh3 };
// The coders (7.2) and the prediction of keys (7.4).
enum : std::uint8_t { kStored = 0, kRans = 1, kDraco = 2 };
inline constexpr std::uint8_t kMorton = 3;

// Returns the components of an attribute; 0 if it is unknown.
int components_of(std::uint16_t attribute);
// Returns the name of a known attribute (6.4).
const char* name_of(std::uint16_t attribute);

// A table of symbol frequencies (A.2).
struct Table {
  bool is_single = false;  // one symbol has all slots: its planes take no bytes
  std::uint8_t only = 0;   // that symbol
  std::array<std::uint16_t, 256> frequency{}, start{};
  std::array<std::uint8_t, kTableTotal> symbol{};  // of each slot
};

// A row of a layout (6.3). `known`: the fields after `coder` are valid.
struct Stream {
  std::uint16_t attribute = 0;
  std::uint8_t components = 0, mapping = 0, prediction = 0, coder = 0;
  bool known = false;
  int exponent = 0, multiplier = 1;
  std::vector<std::uint8_t> bits;  // of each digit
  std::array<float, 3> origin{};
  std::vector<std::uint16_t> tables;  // of each plane, if the coder is kRans

  bool is_optional() const { return attribute >= kOptionalFrom; }
  std::size_t planes() const { return components * bits.size(); }
};

// The layouts of a file or of a record, and their tables.
struct LayoutSet {
  std::vector<Table> tables;
  std::vector<Stream> rows;                // of all layouts
  std::vector<std::uint32_t> ends;         // of the rows of each layout
  std::map<std::size_t, Status> problems;  // refuse the records that name a layout

  std::span<const Stream> streams(std::size_t layout) const {
    const std::size_t first = layout == 0 ? 0 : ends[layout - 1];
    return std::span(rows).subspan(first, ends[layout] - first);
  }
};

// Reads the payload of LAYT, or the layout of a record with max_tables = 256. `lease` charges the
// tables and rows.
Status read_layouts(ByteReader& in, ImportMemory& memory, std::size_t max_tables, LayoutSet& out,
                    Lease& lease);
// Reads a table.
Status read_table(ByteReader& in, Table& out);

// Checks that the sizes in a group of n >= 1 primitives fill it (A.6). Allocates nothing.
Status check_group(View group, std::uint32_t n);
// Decodes a group that check_group() accepts: for each table a plane of n symbols.
Status decode_group(View group, std::uint32_t n, std::span<const Table* const> tables,
                    std::span<std::uint8_t* const> planes);

// Checks that stored bytes can decode to `size` bytes (7.2.2). Allocates nothing.
Status check_stored(View stored, std::uint64_t size);
// Decodes bytes that check_stored(stored, out.size()) accepts.
Status unpack(View stored, std::span<std::uint8_t> out);

}  // namespace stgs::stgs1
