// SPDX-License-Identifier: Apache-2.0
#include "codec/layout.h"

#include <algorithm>
#include <bit>

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kRowLengthBytes = 2;  // before each row

// Returns the number of values of the origin to write: trailing zeros are omitted.
std::size_t origins_of(const StreamRow& row) {
  std::size_t count = std::size(row.origin);
  while (count > 0 && std::bit_cast<std::uint32_t>(row.origin[count - 1]) == 0) --count;
  return count;
}

void write_row(const StreamRow& row, ByteWriter& to) {  // spec 6.2
  ByteWriter out;
  out.u16(row.attribute);
  out.u8(row.mapping);
  out.u8(row.prediction);
  out.u8(row.coder);
  out.u8(row.joins ? 1 : 0);
  out.u8(static_cast<std::uint8_t>(row.step.exponent));
  out.u8(static_cast<std::uint8_t>(row.step.multiplier));
  out.u8(row.low);
  out.u8(row.digits);
  const std::size_t origins = origins_of(row);
  out.u8(static_cast<std::uint8_t>(origins));
  for (std::size_t d = 0; d < row.digits; ++d) out.u8(row.digit_bits[d]);
  for (std::size_t i = 0; i < origins; ++i) out.f32(row.origin[i]);
  for (std::uint16_t table : row.tables) out.u16(table);
  to.u16(static_cast<std::uint16_t>(out.view().size()));
  to.bytes(out.view());
}

// Reads the fields of a row that all versions have.
void read_kind(ByteReader& in, StreamRow& row) {
  row.attribute = in.u16();
  row.mapping = in.u8();
  row.prediction = in.u8();
  row.coder = in.u8();
  row.known = is_known(row);
}

// Reads the other fields of a known row. Bytes after them belong to a later version. Returns false
// if a field is invalid.
bool read_fields(ByteReader& in, std::uint64_t offset, StreamRow& row, Findings& findings) {
  const std::uint8_t joins = in.u8();
  row.joins = joins != 0;
  row.step.exponent = in.i8();
  row.step.multiplier = in.u8();
  row.low = in.u8();
  row.digits = in.u8();
  const std::size_t origins = in.u8();
  if (!in.ok()) return true;  // reported by the caller
  if (joins > 1 || row.low > kMaxLowBits || row.digits == 0 || row.digits > kMaxDigits ||
      origins > std::size(row.origin)) {
    findings.error(N::kStreamShape, offset,
                   "layouts: stream with joins {} (expected 0 or 1), {} low bits (expected at most "
                   "{}), {} digits (expected 1 to {}) and {} origin values (expected at most {})",
                   joins, row.low, kMaxLowBits, row.digits, kMaxDigits, origins,
                   std::size(row.origin));
    return false;
  }
  row.components = static_cast<std::uint8_t>(components_in_planes(row));
  for (std::size_t d = 0; d < row.digits; ++d) row.digit_bits[d] = in.u8();
  for (std::size_t i = 0; i < origins; ++i) row.origin[i] = in.f32();
  if (row.in_group()) {
    for (std::size_t p = 0; p < row.planes() && in.ok(); ++p) row.tables.push_back(in.u16());
  }
  return true;
}

// Reads a row. Returns false if it is invalid.
bool read_row(std::span<const std::uint8_t> bytes, std::uint64_t offset, StreamRow& row,
              Findings& findings) {
  ByteReader in(bytes);
  read_kind(in, row);
  if (row.known && !read_fields(in, offset, row, findings)) return false;
  if (in.ok()) return true;
  findings.error(N::kLayouts, offset, "layouts: row too short ({} bytes)", bytes.size());
  return false;
}

Attribute attribute_of(const StreamRow& row) {
  return static_cast<Attribute>(row.attribute);
}

// Returns whether the planes of a row have fewer symbols than the record has primitives.
bool is_partial(const StreamRow& row) {
  return !row.optional() && band_of(attribute_of(row)) > 0;
}

// Checks that a row may join the group of the row before it (spec 6.5).
bool check_joins(const StreamRow& row, const Layout& before, std::uint64_t offset,
                 Findings& findings) {
  if (!row.joins) return true;
  const StreamRow* const last = before.streams.empty() ? nullptr : &before.streams.back();
  if (row.in_group() && !is_partial(row) && last != nullptr && last->known && last->in_group() &&
      !is_partial(*last)) {
    return true;
  }
  findings.error(N::kStreamShape, offset, "layouts, {}: there is no group that it may join",
                 name_of(attribute_of(row)));
  return false;
}

// Checks that the tables of the planes exist.
bool check_tables(const StreamRow& row, const LayoutSet& set, std::uint64_t offset,
                  Findings& findings) {
  for (std::size_t p = 0; p < row.tables.size(); ++p) {
    const std::size_t table = row.tables[p];
    if (table >= set.tables.size()) {
      findings.error(N::kLayouts, offset, "layouts: invalid table number {} (there are {} tables)",
                     table, set.tables.size());
      return false;
    }
  }
  return true;
}

// Checks the log scales that the steps of rotations depend on (spec 8.8).
bool check_shaped(const Layout& layout, std::uint64_t offset, Findings& findings) {
  const auto is_shaped = [](const StreamRow& row) {
    return row.known && static_cast<Mapping>(row.mapping) == Mapping::kShapedRotation;
  };
  const auto fits = [](const StreamRow& row) {
    return attribute_of(row) != Attribute::kLogScale ||
           (static_cast<Mapping>(row.mapping) == Mapping::kLinear &&
            row.origin[0] == row.origin[1] && row.origin[1] == row.origin[2]);
  };
  if (std::none_of(layout.streams.begin(), layout.streams.end(), is_shaped) ||
      std::all_of(layout.streams.begin(), layout.streams.end(), fits)) {
    return true;
  }
  findings.error(N::kStreamShape, offset,
                 "layouts: shaped rotations with log scales that have another mapping than 1, or "
                 "different origins");
  return false;
}

// Reads the rows of a layout.
bool read_rows(std::span<const std::span<const std::uint8_t>> rows, std::uint64_t offset,
               const LayoutSet& set, Layout& layout, Findings& findings) {
  std::size_t in_group = 0, max_planes = 0;
  std::uint64_t at = offset;
  for (const std::span<const std::uint8_t> bytes : rows) {
    StreamRow row;
    at += kRowLengthBytes;
    if (!read_row(bytes, at, row, findings)) return false;
    if (row.optional() && row.in_group()) {
      findings.error(N::kStreamShape, at, "layouts: optional attribute {} is coded with rANS",
                     row.attribute);
      return false;
    }
    if (!row.known) {  // records with this layout are rejected later
      layout.streams.push_back(std::move(row));
      at += bytes.size();
      continue;
    }
    if (!check_row(row, at, findings) || !check_joins(row, layout, at, findings) ||
        !check_tables(row, set, at, findings)) {
      return false;
    }
    max_planes += sizeof(float) * static_cast<std::size_t>(components_of(attribute_of(row)));
    in_group = (row.joins ? in_group : 0) + Layout::varying_planes(row, set);
    if (row.in_group() && in_group > kRansPlanes) {
      findings.error(N::kLayouts, at,
                     "layouts: too many planes in a group (expected at most {}, got {})",
                     kRansPlanes, in_group);
      return false;
    }
    layout.streams.push_back(std::move(row));
    at += bytes.size();
  }
  if (layout.planes() > max_planes) {  // spec 8.1
    findings.error(N::kStreamShape, offset,
                   "layouts: too many planes (expected at most {}, got {})", max_planes,
                   layout.planes());
    return false;
  }
  return check_shaped(layout, offset, findings);
}

// Reads a layout and returns the number of its rows. An invalid row affects this layout only,
// unless its bytes are missing.
std::size_t read_layout(ByteReader& in, std::uint64_t offset, const LayoutSet& set,
                        Layout& layout) {
  const std::uint64_t at = offset + in.position() + 1;
  std::vector<std::span<const std::uint8_t>> rows(in.u8());
  for (auto& row : rows) row = in.bytes(in.u16());
  if (!in.ok()) return 0;  // reported by the caller
  Findings found;
  if (read_rows(rows, at, set, layout, found)) return rows.size();
  Issue issue = std::move(found.take().front());
  layout.problem = issue.number;
  layout.problem_at = issue.offset;
  layout.why = std::move(issue.message);
  return rows.size();
}

}  // namespace

std::vector<Layout::Unit> Layout::units() const {
  std::vector<Unit> out;
  for (std::size_t i = 0; i < streams.size(); ++i) {
    if (streams[i].joins && !out.empty()) {
      ++out.back().count;
    } else {
      out.push_back({i, 1});
    }
  }
  return out;
}

std::size_t Layout::planes() const {
  std::size_t planes = 0;
  for (const StreamRow& row : streams) {
    if (!row.optional()) planes += row.planes();
  }
  return planes;
}

std::size_t Layout::varying_planes(const StreamRow& row, const LayoutSet& set) {
  if (!row.in_group()) return row.planes();
  return static_cast<std::size_t>(
      std::count_if(row.tables.begin(), row.tables.end(),
                    [&](const std::uint16_t table) { return set.only[table] < 0; }));
}

bool Layout::has_sh_degree() const {
  return std::any_of(streams.begin(), streams.end(), [](const StreamRow& row) {
    return row.attribute == static_cast<std::uint16_t>(Attribute::kShDegree);
  });
}

bool Layout::has_first_key() const {
  return std::any_of(streams.begin(), streams.end(), [](const StreamRow& row) {
    return !row.optional() && static_cast<Prediction>(row.prediction) == Prediction::kMorton;
  });
}

std::int16_t only_symbol(const RansTable& table) {
  for (std::size_t s = 0; s < table.frequency.size(); ++s) {
    if (table.frequency[s] == kRansTotal) return static_cast<std::int16_t>(s);
  }
  return -1;
}

void write_layouts(const LayoutSet& set, ByteWriter& out) {  // spec 6.1
  out.u16(static_cast<std::uint16_t>(set.tables.size()));
  for (const RansTable& table : set.tables) write_rans_table(table, out);
  out.u16(static_cast<std::uint16_t>(set.layouts.size()));
  for (const Layout& layout : set.layouts) {
    out.u8(static_cast<std::uint8_t>(layout.streams.size()));
    for (const StreamRow& row : layout.streams) write_row(row, out);
  }
}

void mark_tables(const LayoutSet& set, const StreamRow& row, std::vector<bool>& used) {
  for (const std::uint16_t table : row.tables) {
    if (table >= set.tables.size() || set.only[table] >= 0)
      continue;  // first: a problem of the row
    if (table >= used.size()) used.resize(table + std::size_t{1});
    used[table] = true;
  }
}

void make_lookups(LayoutSet& set) {
  std::vector<bool> used;
  for (const Layout& layout : set.layouts)
    for (const StreamRow& row : layout.streams) mark_tables(set, row, used);
  set.lookups.resize(used.size());
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i]) rans_lookup(set.tables[i], set.lookups[i]);
}

bool parse_layouts(ByteReader& in, std::uint64_t offset, std::size_t max_tables,
                   std::size_t max_layouts, std::uint64_t memory, LayoutSet& set,
                   Findings& findings) {
  const std::size_t tables = in.u16();
  if (tables > max_tables) {
    findings.error(N::kLayouts, offset, "layouts: too many tables (expected at most {}, got {})",
                   max_tables, tables);
    return false;
  }
  if (tables > memory / kTableMemory) {
    findings.unsupported(
        N::kMemoryLimit, offset,
        "the index needs {} bytes for {} tables of symbols, more than the {} that remain of the "
        "memory limit; allow more memory",
        tables * kTableMemory, tables, memory);
    return false;
  }
  // A table takes a byte at least.
  set.tables.reserve(std::min(tables, in.left()));
  set.only.reserve(std::min(tables, in.left()));
  for (std::size_t i = 0; i < tables; ++i) {
    const std::size_t begin = in.position();
    std::int16_t only = -1;
    if (!read_rans_table(in, set.tables.emplace_back(), only)) {
      set.tables.pop_back();
      findings.error(N::kLayouts, offset, "layouts: invalid table of symbol frequencies at byte {}",
                     begin);
      return false;
    }
    set.only.push_back(only);
  }
  const std::size_t layouts = in.u16();
  if (layouts > max_layouts) {
    findings.error(N::kLayouts, offset, "layouts: too many layouts (expected at most {}, got {})",
                   max_layouts, layouts);
    return false;
  }
  // At most those that the bytes and the limit below allow. A layout takes a byte at least.
  static_assert(sizeof(Layout) <= kRowMemory);
  set.layouts.reserve(
      set.layouts.size() +
      std::min({layouts, in.left(), static_cast<std::size_t>(kFreeRows + memory / kRowMemory)}));
  for (std::size_t i = 0; i < layouts && in.ok(); ++i) {
    Layout layout;
    const std::uint64_t entries = set.entries += 1 + read_layout(in, offset, set, layout);
    if (entries > kFreeRows && entries - kFreeRows > memory / kRowMemory) {
      findings.unsupported(N::kMemoryLimit, offset,
                           "layouts: {} layouts and rows exceed the memory limit of {} bytes",
                           entries, memory);
      return false;
    }
    set.layouts.push_back(std::move(layout));
  }
  if (!in.ok()) {
    findings.error(N::kLayouts, offset, "layouts: truncated");
    return false;
  }
  return set.layouts.size() == layouts;
}

}  // namespace stgs
