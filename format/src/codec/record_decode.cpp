// SPDX-License-Identifier: Apache-2.0
#include "codec/record_decode.h"

#include <algorithm>

#include "codec/draco_points.h"

namespace stgs {
namespace {

using N = IssueNumber;

}  // namespace

void DecodedRows::skip(std::size_t count) {
  for (std::vector<Plane>& of_row : planes) {
    for (Plane& plane : of_row)
      if (plane.symbols != nullptr) plane.symbols += count;
  }
}

RecordDecoder::RecordDecoder(const SegmentRecord& record, const FileHead& head,
                             std::uint32_t ordinal, Findings& findings)
    : record_(record),
      set_(record.set(*head.layouts)),
      layout_(record.layout_in(*head.layouts)),
      ordinal_(ordinal),
      n_(head.segment(ordinal).base.primitives),
      sh_degree_(head.metadata.sh_degree),
      findings_(findings),
      groups_(record.units.size()) {}

std::uint32_t RecordDecoder::symbols_of(const StreamRow& row) const {
  const int band = row.optional() ? 0 : band_of(static_cast<Attribute>(row.attribute));
  return band == 0 ? n_ : record_.sh[static_cast<std::size_t>(band - 1)];
}

std::size_t RecordDecoder::coded_planes(Layout::Unit unit) const {
  std::size_t out = 0;
  for (std::size_t i = unit.first; i < unit.first + unit.count; ++i)
    out += Layout::varying_planes(layout_.streams[i], set_);
  return out;
}

bool RecordDecoder::corrupt(std::size_t row, const char* problem) const {
  findings_.error(N::kStreamCorrupt, record_.payload_at, "segment {}, {}: {}", ordinal_,
                  name_of(static_cast<Attribute>(layout_.streams[row].attribute)), problem);
  return false;
}

bool RecordDecoder::open_unit(std::size_t u) {
  const SegmentRecord::Unit& unit = record_.units[u];
  const StreamRow& row = layout_.streams[unit.rows.first];
  const std::uint32_t symbols = symbols_of(row);
  if (row.optional()) return true;
  if (static_cast<Coder>(row.coder) == Coder::kDraco) {
    if (!check_draco().ok()) {
      findings_.not_built(N::kStreamUnsupported, record_.payload_at, check_draco());
      return false;
    }
    return draco_fits(unit.bytes, symbols) ||
           corrupt(unit.rows.first, "point cloud does not match the number of primitives");
  }
  if (!row.in_group()) {
    return unit.bytes.size() == std::uint64_t{symbols} * row.planes() ||
           corrupt(unit.rows.first, "the bytes do not match the number of primitives");
  }
  if (coded_planes(unit.rows) == 0 || symbols == 0)
    return unit.bytes.empty() || corrupt(unit.rows.first, "bytes in a group of no symbols");
  auto group = RansGroupDecoder::open(unit.bytes, symbols);
  if (!group.ok()) return corrupt(unit.rows.first, group.status().message().c_str());
  groups_[u].emplace(std::move(*group));
  return true;
}

bool RecordDecoder::open() {
  bool good = true;
  for (std::size_t u = 0; u < record_.units.size(); ++u) good = open_unit(u) && good;
  return good;
}

bool RecordDecoder::is_needed(Layout::Unit unit, AttributeBits attributes) const {
  const std::span rows = std::span(layout_.streams).subspan(unit.first, unit.count);
  return std::any_of(rows.begin(), rows.end(), [&](const StreamRow& row) {
    return !row.optional() &&
           (attributes & attribute_bit(static_cast<Attribute>(row.attribute))) != 0;
  });
}

std::size_t RecordDecoder::count_in(const DecodeRange& range, const StreamRow& row) const {
  const std::size_t symbols = symbols_of(row);
  return std::min(symbols, range.end) - std::min(symbols, range.begin);
}

void RecordDecoder::assign_rows(std::size_t first, std::size_t count, const DecodeRange& range,
                                DecodedRows& out) const {
  std::vector<const std::uint8_t*> stored(layout_.streams.size());  // planes of units of one stream
  std::vector<bool> needed(layout_.streams.size());
  for (const SegmentRecord::Unit& unit : record_.units) {
    const StreamRow& row = layout_.streams[unit.rows.first];
    stored[unit.rows.first] =
        static_cast<Coder>(row.coder) == Coder::kDraco ? points_.data() : unit.bytes.data();
    std::fill_n(needed.begin() + static_cast<std::ptrdiff_t>(unit.rows.first), unit.rows.count,
                is_needed(unit.rows, range.attributes));
  }
  std::size_t size = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    const StreamRow& row = layout_.streams[i];
    needed[i] = needed[i] && !row.optional();
    if (needed[i] && row.in_group())
      size += Layout::varying_planes(row, set_) * count_in(range, row);
  }
  if (size > out.capacity) {
    out.symbols = std::make_unique_for_overwrite<std::uint8_t[]>(size);
    out.capacity = size;
  }
  out.first = first;
  out.areas.assign(count, nullptr);
  out.planes.assign(count, {});
  std::uint8_t* at = out.symbols.get();
  for (std::size_t i = first; i < first + count; ++i) {
    const StreamRow& row = layout_.streams[i];
    out.areas[i - first] = at;
    for (std::size_t p = 0; p < row.planes() && needed[i]; ++p) {
      std::vector<Plane>& planes = out.planes[i - first];
      if (!row.in_group()) {
        planes.push_back({stored[i] + p * symbols_of(row) + range.begin, 0});
      } else if (const std::int16_t only = set_.only[row.tables[p]]; only >= 0) {
        planes.push_back({nullptr, static_cast<std::uint8_t>(only)});
      } else {
        planes.push_back({at, 0});
        at += count_in(range, row);
      }
    }
  }
}

std::vector<RansPlaneTask> RecordDecoder::tasks_of(std::size_t u, const DecodeRange& range,
                                                   const DecodedRows& rows) const {
  std::vector<RansPlaneTask> out;
  const Layout::Unit unit = record_.units[u].rows;
  for (std::size_t i = unit.first; i < unit.first + unit.count; ++i) {
    std::uint8_t* at = rows.areas[i - rows.first];
    for (const std::uint16_t table : layout_.streams[i].tables) {
      if (set_.only[table] >= 0) continue;
      const bool is_made_later = record_.has_own && is_short(u);
      out.push_back({is_made_later ? nullptr : &lookup_of(table), at, &set_.tables[table]});
      at += count_in(range, layout_.streams[i]);
    }
  }
  return out;
}

bool RecordDecoder::decode_groups_of(std::span<const std::size_t> units, const DecodeRange& range,
                                     const DecodedRows& rows) {
  std::vector<std::vector<RansPlaneTask>> tasks;
  for (const std::size_t u : units) tasks.push_back(tasks_of(u, range, rows));
  std::vector<RansQueue> queues;
  for (std::size_t k = 0; k < units.size(); ++k) queues.push_back({&*groups_[units[k]], tasks[k]});
  // The longest first, so that the others fill the gaps.
  std::stable_sort(queues.begin(), queues.end(), [](const RansQueue& a, const RansQueue& b) {
    return a.planes.size() > b.planes.size();
  });
  decode_groups(queues, range.begin, range.end);
  for (const std::size_t u : units) {
    const std::size_t row = record_.units[u].rows.first;
    const bool last = range.end >= symbols_of(layout_.streams[row]);
    if (last && !groups_[u]->finish()) return corrupt(row, "a block does not end correctly");
  }
  return true;
}

bool RecordDecoder::decode_points(std::size_t u) {
  if (!points_.empty()) return true;
  const SegmentRecord::Unit& unit = record_.units[u];
  const StreamRow& row = layout_.streams[unit.rows.first];
  points_.resize(row.planes() * symbols_of(row));
  const char* const problem = draco_decode(unit.bytes, symbols_of(row), points_);
  return problem == nullptr || corrupt(unit.rows.first, problem);
}

bool RecordDecoder::decode_units(std::size_t first, std::size_t last, const DecodeRange& range,
                                 DecodedRows& rows) {
  make_own_lookups();
  std::vector<std::size_t> groups;
  for (std::size_t u = first; u < last; ++u) {
    const StreamRow& row = layout_.streams[record_.units[u].rows.first];
    if (!is_needed(record_.units[u].rows, range.attributes)) continue;
    if (groups_[u]) groups.push_back(u);
    if (static_cast<Coder>(row.coder) == Coder::kDraco && !decode_points(u)) return false;
  }
  const std::size_t begin = record_.units[first].rows.first;
  const Layout::Unit end = record_.units[last - 1].rows;
  assign_rows(begin, end.first + end.count - begin, range, rows);
  return decode_groups_of(groups, range, rows);
}

std::uint32_t RecordDecoder::symbols_of(Attribute attribute) const {
  for (const StreamRow& row : layout_.streams) {
    if (!row.optional() && static_cast<Attribute>(row.attribute) == attribute)
      return symbols_of(row);
  }
  return 0;
}

std::size_t RecordDecoder::symbol_bytes(AttributeBits attributes) const {
  std::size_t out = 0;
  for (const StreamRow& row : layout_.streams) {
    if (row.optional() || !row.in_group()) continue;
    if ((attributes & attribute_bit(static_cast<Attribute>(row.attribute))) != 0)
      out += Layout::varying_planes(row, set_);
  }
  return out;
}

const StreamRow* RecordDecoder::degree_row() const {
  const auto row = std::find_if(layout_.streams.begin(), layout_.streams.end(), [](const auto& r) {
    return r.attribute == static_cast<std::uint16_t>(Attribute::kShDegree);
  });
  return row == layout_.streams.end() ? nullptr : &*row;
}

bool RecordDecoder::check_degrees(std::uint32_t greatest,
                                  const std::array<std::size_t, kShBands>& counts) const {
  if (greatest > static_cast<std::uint32_t>(sh_degree_)) {
    findings_.error(N::kStreamValue, record_.payload_at,
                    "segment {}: SH degree {} in a scene of degree {}", ordinal_, greatest,
                    sh_degree_);
    return false;
  }
  for (std::size_t k = 0; k < kShBands; ++k) {
    if (counts[k] == record_.sh[k]) continue;
    findings_.error(N::kStreamValue, record_.payload_at,
                    "segment {}: {} primitives have SH of degree {} (expected {})", ordinal_,
                    counts[k], k + 1, record_.sh[k]);
    return false;
  }
  return true;
}

bool RecordDecoder::find_members(DecodedRows& rows) {
  const StreamRow* const row = degree_row();
  if (row == nullptr) return true;
  const ShDegrees degrees(*row, planes_of(*row, rows), n_);
  if (!check_degrees(degrees.greatest(), degrees.counts())) return false;
  rows.members = degrees.members();
  return true;
}

bool RecordDecoder::decode(AttributeBits attributes, DecodedRows& out) {
  if (!decode_range({attributes}, out)) return false;
  const bool degrees = (attributes & attribute_bit(Attribute::kShDegree)) != 0;
  return !degrees || find_members(out);
}

bool RecordDecoder::is_short(std::size_t u) const {
  return rans_lanes(symbols_of(layout_.streams[record_.units[u].rows.first])) < kRansVectorLanes;
}

std::vector<bool> RecordDecoder::own_tables(bool all) const {
  std::vector<bool> used;
  for (std::size_t u = 0; u < groups_.size(); ++u) {
    if (!groups_[u] || (!all && is_short(u))) continue;
    const Layout::Unit unit = record_.units[u].rows;
    for (const StreamRow& row : std::span(layout_.streams).subspan(unit.first, unit.count))
      mark_tables(set_, row, used);
  }
  return used;
}

void RecordDecoder::make_own_lookups() {
  if (!record_.has_own || own_lookups_ != nullptr) return;
  const std::vector<bool> used = own_tables(false);
  own_lookups_ = std::make_unique_for_overwrite<RansLookup[]>(used.size());
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i]) rans_lookup(set_.tables[i], own_lookups_[i]);
}

bool RecordDecoder::decode_range(const DecodeRange& range, DecodedRows& out) {
  return decode_units(0, record_.units.size(), range, out);
}

void RecordDecoder::add_tasks(AttributeBits attributes, const DecodedRows& rows,
                              std::vector<StreamTask>& tasks) const {
  for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
    const StreamRow& row = layout_.streams[i];
    const auto attribute = static_cast<Attribute>(row.attribute);
    if (row.optional() || attribute == Attribute::kShDegree || symbols_of(row) == 0 ||
        (attributes & attribute_bit(attribute)) == 0) {
      continue;
    }
    const int band = band_of(attribute);
    tasks.push_back({&row, rows.planes[i].data(), {}});
    // Rows of a range have no members.
    if (band > 0 && symbols_of(row) < n_)
      tasks.back().members = rows.members[static_cast<std::size_t>(band - 1)];
  }
}

bool RecordDecoder::decode_degrees(ShMembers& members) {
  for (std::size_t u = 0; u < record_.units.size(); ++u) {
    const Layout::Unit unit = record_.units[u].rows;
    const auto rows = std::span(layout_.streams).subspan(unit.first, unit.count);
    if (std::none_of(rows.begin(), rows.end(), [](const StreamRow& row) {
          return row.attribute == static_cast<std::uint16_t>(Attribute::kShDegree);
        })) {
      continue;
    }
    DecodedRows decoded;
    if (!decode_units(u, u + 1, {}, decoded) || !find_members(decoded)) return false;
    members = std::move(decoded.members);
  }
  return true;
}

CodedStream RecordDecoder::coded_stream(const StreamRow& row, const ShMembers& members) const {
  CodedStream out;
  out.attribute = static_cast<Attribute>(row.attribute);
  out.mapping = static_cast<Mapping>(row.mapping);
  out.prediction = static_cast<Prediction>(row.prediction);
  out.step = row.step;
  out.symbols = symbols_of(row);
  if (const int band = band_of(out.attribute); band > 0 && out.symbols < n_)
    out.members = members[static_cast<std::size_t>(band - 1)];
  out.components = row.components;
  out.digits = row.digits;
  out.digit_bits = row.digit_bits;
  out.low = row.low;
  std::copy_n(row.origin, 3, out.origin.begin());
  return out;
}

bool RecordDecoder::code(CodedRecord& out) {
  ShMembers members;
  if (!decode_degrees(members)) return false;
  std::size_t decoded = 0;  // bytes of the planes of groups so far
  for (const SegmentRecord::Unit& unit : record_.units) {
    const StreamRow& first = layout_.streams[unit.rows.first];
    const std::uint32_t symbols = symbols_of(first);
    const bool degrees =
        unit.rows.count == 1 && first.attribute == static_cast<std::uint16_t>(Attribute::kShDegree);
    if (first.optional() || symbols == 0 || degrees) continue;
    CodedGroup group;
    group.symbols = symbols;
    for (std::size_t i = unit.rows.first; i < unit.rows.first + unit.rows.count; ++i) {
      const StreamRow& row = layout_.streams[i];
      CodedStream stream = coded_stream(row, members);
      for (std::size_t p = 0; p < row.planes(); ++p) {
        const std::int16_t only = row.in_group() ? set_.only[row.tables[p]] : std::int16_t{-1};
        if (!row.in_group()) {
          stream.planes.push_back(
              {CodedPlane::Source::kStored, 0, out.stored.size() + p * symbols});
        } else if (only >= 0) {
          stream.planes.push_back(
              {CodedPlane::Source::kConstant, static_cast<std::uint8_t>(only), 0});
        } else {
          stream.planes.push_back({CodedPlane::Source::kGroup, 0, decoded});
          group.tables.push_back(row.tables[p]);
          decoded += symbols;
        }
      }
      if (stream.attribute != Attribute::kShDegree) out.streams.push_back(std::move(stream));
    }
    if (!first.in_group()) {
      const std::size_t at = out.stored.size();
      out.stored.resize(at + first.planes() * symbols);
      const std::span area = std::span(out.stored).subspan(at);
      if (static_cast<Coder>(first.coder) == Coder::kDraco) {
        if (const char* problem = draco_decode(unit.bytes, symbols, area))
          return corrupt(unit.rows.first, problem);
      } else {
        std::copy(unit.bytes.begin(), unit.bytes.end(), area.begin());
      }
    } else if (!group.tables.empty()) {
      Result<std::vector<RansBlockLocation>> blocks = rans_layout(unit.bytes, symbols);
      if (!blocks.ok()) return corrupt(unit.rows.first, blocks.status().message().c_str());
      group.blocks = std::move(*blocks);
      group.offset = out.bytes.size();
      group.size = unit.bytes.size();
      out.bytes.insert(out.bytes.end(), unit.bytes.begin(), unit.bytes.end());
      out.groups.push_back(std::move(group));
    }
  }
  out.own_tables = record_.has_own;
  if (!record_.has_own) return true;
  const std::vector<bool> used = own_tables(true);
  out.lookups.resize(used.size());
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i]) rans_lookup(set_.tables[i], out.lookups[i]);
  return true;
}

}  // namespace stgs
