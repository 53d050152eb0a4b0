// SPDX-License-Identifier: Apache-2.0
#include "codec/record_decode.h"

#include <algorithm>

#include "codec/draco_points.h"

namespace stgs {
namespace {

using N = IssueNumber;

}  // namespace

RecordDecoder::RecordDecoder(const SegmentRecord& record, const FileHead& head,
                             std::uint32_t ordinal, Findings& findings)
    : record_(record),
      set_(record.set(*head.layouts)),
      layout_(record.layout_in(*head.layouts)),
      ordinal_(ordinal),
      n_(head.index.segments[ordinal].base.primitives),
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

DecodedRows RecordDecoder::assign_rows(std::size_t first, std::size_t count,
                                       AttributeBits attributes) const {
  DecodedRows out;
  out.first = first;
  std::vector<bool> needed(layout_.streams.size());
  for (const SegmentRecord::Unit& unit : record_.units) {
    std::fill_n(needed.begin() + static_cast<std::ptrdiff_t>(unit.rows.first), unit.rows.count,
                is_needed(unit.rows, attributes));
  }
  std::size_t size = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    const StreamRow& row = layout_.streams[i];
    if (needed[i] && !row.optional()) size += Layout::varying_planes(row, set_) * symbols_of(row);
  }
  out.symbols = std::make_unique_for_overwrite<std::uint8_t[]>(size);
  std::uint8_t* at = out.symbols.get();
  for (std::size_t i = first; i < first + count; ++i) {
    const StreamRow& row = layout_.streams[i];
    std::uint8_t* const begin = at;
    std::vector<Plane>& planes = out.planes.emplace_back();
    for (std::size_t p = 0; p < row.planes() && needed[i] && !row.optional(); ++p) {
      const std::int16_t only = row.in_group() ? set_.only[row.tables[p]] : std::int16_t{-1};
      planes.push_back(only < 0 ? Plane{at, 0} : Plane{nullptr, static_cast<std::uint8_t>(only)});
      at += only < 0 ? symbols_of(row) : 0;
    }
    out.areas.emplace_back(begin, at);
  }
  return out;
}

std::vector<RansPlaneTask> RecordDecoder::tasks_of(std::size_t u, DecodedRows& rows) const {
  std::vector<RansPlaneTask> out;
  const Layout::Unit unit = record_.units[u].rows;
  for (std::size_t i = unit.first; i < unit.first + unit.count; ++i) {
    std::uint8_t* at = rows.areas[i - rows.first].data();
    for (const std::uint16_t table : layout_.streams[i].tables) {
      if (set_.only[table] >= 0) continue;
      out.push_back({&set_.lookups[table], at});
      at += symbols_of(layout_.streams[i]);
    }
  }
  return out;
}

bool RecordDecoder::decode_groups_of(std::span<const std::size_t> units, DecodedRows& rows) {
  std::vector<std::vector<RansPlaneTask>> tasks;
  for (const std::size_t u : units) tasks.push_back(tasks_of(u, rows));
  std::vector<RansQueue> queues;
  for (std::size_t k = 0; k < units.size(); ++k) queues.push_back({&*groups_[units[k]], tasks[k]});
  // The longest first, so that the others fill the gaps.
  std::stable_sort(queues.begin(), queues.end(), [](const RansQueue& a, const RansQueue& b) {
    return a.planes.size() > b.planes.size();
  });
  decode_groups(queues);
  for (const std::size_t u : units) {
    if (!groups_[u]->finish())
      return corrupt(record_.units[u].rows.first, "a block does not end correctly");
  }
  return true;
}

bool RecordDecoder::decode_stored(std::size_t u, DecodedRows& rows) {
  const SegmentRecord::Unit& unit = record_.units[u];
  const StreamRow& row = layout_.streams[unit.rows.first];
  const std::span<std::uint8_t> area = rows.areas[unit.rows.first - rows.first];
  if (static_cast<Coder>(row.coder) == Coder::kDraco) {
    const char* const problem = draco_decode(unit.bytes, symbols_of(row), area);
    return problem == nullptr || corrupt(unit.rows.first, problem);
  }
  std::copy(unit.bytes.begin(), unit.bytes.end(), area.begin());
  return true;
}

bool RecordDecoder::decode_units(std::size_t first, std::size_t last, AttributeBits attributes,
                                 DecodedRows& rows) {
  std::vector<std::size_t> groups;
  for (std::size_t u = first; u < last; ++u) {
    const StreamRow& row = layout_.streams[record_.units[u].rows.first];
    if (!is_needed(record_.units[u].rows, attributes)) continue;
    if (groups_[u]) groups.push_back(u);
    if (!row.in_group() && !decode_stored(u, rows)) return false;
  }
  return decode_groups_of(groups, rows);
}

bool RecordDecoder::find_members(DecodedRows& rows) {
  const auto row = std::find_if(layout_.streams.begin(), layout_.streams.end(), [](const auto& r) {
    return r.attribute == static_cast<std::uint16_t>(Attribute::kShDegree);
  });
  if (row == layout_.streams.end()) return true;
  const auto number = static_cast<std::size_t>(row - layout_.streams.begin());
  const std::vector<Plane>& planes = rows.planes[number - rows.first];
  const ShDegrees degrees(*row, planes, n_);
  if (degrees.greatest() > static_cast<std::uint32_t>(sh_degree_)) {
    findings_.error(N::kStreamValue, record_.payload_at,
                    "segment {}: SH degree {} in a scene of degree {}", ordinal_,
                    degrees.greatest(), sh_degree_);
    return false;
  }
  for (std::uint32_t k = 0; k < kShBands; ++k) {
    const std::size_t found = degrees.count(k + 1);
    if (found == record_.sh[k]) continue;
    findings_.error(N::kStreamValue, record_.payload_at,
                    "segment {}: {} primitives have SH of degree {} (expected {})", ordinal_, found,
                    k + 1, record_.sh[k]);
    return false;
  }
  rows.members = degrees.members();
  return true;
}

bool RecordDecoder::decode(AttributeBits attributes, DecodedRows& out) {
  out = assign_rows(0, layout_.streams.size(), attributes);
  if (!decode_units(0, record_.units.size(), attributes, out)) return false;
  const bool degrees = (attributes & attribute_bit(Attribute::kShDegree)) != 0;
  return !degrees || find_members(out);
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
    DecodedRows decoded = assign_rows(unit.first, unit.count, kAllAttributes);
    if (!decode_units(u, u + 1, kAllAttributes, decoded) || !find_members(decoded)) return false;
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
  if (record_.has_own) out.lookups = set_.lookups;
  return true;
}

}  // namespace stgs
