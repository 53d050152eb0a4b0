// SPDX-License-Identifier: Apache-2.0
#include "stgs_file.h"

#include <libdeflate.h>

#include <algorithm>
#include <cstring>
#include <string_view>

#include "../fixtures/scene_fixture.h"
#include "codec/layout.h"
#include "core/bytes.h"

namespace stgs::fuzz {
namespace {

constexpr std::size_t kHeader = 32, kRecord = 24;  // spec 2.1, 3.1
constexpr std::size_t kMaxPlaneBytes = 1 << 20;    // larger groups are not repaired
constexpr std::uint64_t kTablesMemory = kMaxTables * kTableMemory;

template <typename Value>
Value get(View bytes, std::size_t at) {
  Value v{};
  if (at <= bytes.size() && sizeof v <= bytes.size() - at) std::memcpy(&v, &bytes[at], sizeof v);
  return v;
}
template <typename Value>
void put(Bytes& bytes, std::size_t at, Value v) {
  if (at <= bytes.size() && sizeof v <= bytes.size() - at) std::memcpy(&bytes[at], &v, sizeof v);
}

std::uint32_t hash(View bytes) {
  return libdeflate_crc32(0, bytes.data(), bytes.size());
}

// Returns whether there is a record header with a valid checksum at the offset.
bool is_record(View file, std::size_t at) {
  return at <= file.size() && kRecord <= file.size() - at &&
         get<std::uint32_t>(file, at + 20) == hash(file.subspan(at, 20));
}

struct Record {
  std::size_t begin = 0, end = 0;
  std::string_view tag(View file) const {
    return {reinterpret_cast<const char*>(file.data()) + begin, 4};
  }
  View payload(View file) const { return file.subspan(begin + kRecord, end - begin - kRecord); }
};

// Finds records by their lengths; clips the last one to the file.
std::vector<Record> records_by_length(View file) {
  std::vector<Record> out;
  for (std::size_t at = kHeader; at < file.size() && kRecord <= file.size() - at;) {
    const auto length = get<std::uint64_t>(file, at + 8);
    const std::size_t left = file.size() - at - kRecord;
    const std::size_t end = at + kRecord + std::min<std::uint64_t>(length, left);
    out.push_back({at, end});
    at = end;
  }
  return out;
}

// Finds records by their headers: a record that has grown ends where the next one begins.
std::vector<Record> records_by_header(View file) {
  std::vector<Record> out;
  for (std::size_t at = kHeader; at < file.size(); ++at) {
    if (!is_record(file, at)) continue;
    if (!out.empty()) out.back().end = at;
    out.push_back({at, file.size()});
    at += kRecord - 1;
  }
  return out;
}

// A SEGM record's payload (spec 6.5), as far as it can be parsed.
class ParsedSegment {
 public:
  ParsedSegment(View payload, const LayoutSet& file_layouts) : payload_(payload), in_(payload) {
    in_.bytes(8);
    n_ = in_.u32();
    std::uint16_t number = in_.u16();
    Findings findings;
    set_ = &file_layouts;
    if (number == kOwnLayout) {
      if (!parse_layouts(in_, 0, kMaxOwnTables, 1, kTablesMemory, own_, findings)) return;
      make_lookups(own_);
      number = 0;
      set_ = &own_;
    }
    if (!in_.ok() || number >= set_->layouts.size()) return;
    const Layout& layout = set_->layouts[number];
    if (layout.problem != 0) return;
    if (layout.has_sh_degree()) read_band_counts(layout);
    if (layout.has_first_key()) in_.u32();
    sizes_at_ = in_.position();
    layout_ = &layout;
    units_ = layout.units();
    for (std::size_t i = 0; i < units_.size(); ++i) sizes_.push_back(in_.u32());
  }

  // Returns the payload with groups that decode to the same symbols and end correctly (spec 7.4),
  // and a size of the last unit that fills the payload.
  Bytes repaired() {
    if (layout_ == nullptr || !in_.ok()) return {payload_.begin(), payload_.end()};
    ByteWriter units, out;
    out.bytes(payload_.first(sizes_at_));
    for (std::size_t i = 0; i < units_.size(); ++i) {
      const bool last = i + 1 == units_.size();
      const View unit = in_.bytes(last ? in_.left() : std::min<std::size_t>(sizes_[i], in_.left()));
      const Bytes bytes = with_correct_end(units_[i], unit);
      out.u32(static_cast<std::uint32_t>(bytes.size()));
      units.bytes(bytes);
    }
    out.bytes(units.view());
    return out.take();
  }

 private:
  void read_band_counts(const Layout& layout) {
    for (const StreamRow& row : layout.streams) {
      const int band = band_of(static_cast<Attribute>(row.attribute));
      if (band > 0 && band <= kShBands) bands_.resize(static_cast<std::size_t>(band));
    }
    for (std::uint32_t& count : bands_) count = in_.u32();
  }
  std::size_t symbols_of(const StreamRow& row) const {
    const auto band = static_cast<std::size_t>(band_of(static_cast<Attribute>(row.attribute)));
    return band == 0 || band > bands_.size() ? n_ : bands_[band - 1];
  }

  // Returns the bytes of a unit, or, if it is a group that can be decoded, those that encode its
  // symbols.
  Bytes with_correct_end(const Layout::Unit& unit, View bytes) const {
    const Bytes same(bytes.begin(), bytes.end());
    const std::span rows = std::span(layout_->streams).subspan(unit.first, unit.count);
    if (!rows[0].in_group() ||
        (band_of(static_cast<Attribute>(rows[0].attribute)) > 0 && !layout_->has_sh_degree())) {
      return same;
    }
    const std::size_t n = symbols_of(rows[0]);
    std::vector<std::uint16_t> tables;
    for (const StreamRow& row : rows) {
      for (const std::uint16_t table : row.tables) {
        if (set_->only[table] < 0) tables.push_back(table);
      }
    }
    if (n == 0 || n * tables.size() > kMaxPlaneBytes) return same;
    auto group = RansGroupDecoder::open(bytes, n);
    if (!group.ok()) return same;
    Bytes symbols(n * tables.size());
    std::vector<RansPlane> planes;
    for (std::size_t i = 0; i < tables.size(); ++i) {
      group->next_plane(set_->lookups[tables[i]], symbols.data() + n * i);
      planes.push_back({View(symbols).subspan(n * i, n), &set_->tables[tables[i]]});
    }
    if (group->finish()) return same;
    auto encoded = rans_encode(planes, n);
    return encoded.ok() ? std::move(*encoded) : same;
  }

  View payload_;
  ByteReader in_;
  std::size_t n_ = 0, sizes_at_ = 0;
  LayoutSet own_;
  const LayoutSet* set_ = nullptr;
  const Layout* layout_ = nullptr;
  std::vector<std::uint32_t> bands_;  // primitives with a degree of at least 1, 2 and 3
  std::vector<Layout::Unit> units_;
  std::vector<std::uint32_t> sizes_;
};

LayoutSet read_layouts(View file, const std::vector<Record>& records) {
  LayoutSet set;
  for (const Record& record : records) {
    if (record.tag(file) != "LAYT") continue;
    ByteReader in(record.payload(file));
    Findings findings;
    LayoutSet parsed;
    if (parse_layouts(in, 0, kMaxTables, kMaxLayouts, kTablesMemory, parsed, findings)) {
      make_lookups(parsed);
      set = std::move(parsed);
    }
  }
  return set;
}

// Returns the file with repaired payloads of its segments.
Bytes with_repaired_segments(View file) {
  const std::vector<Record> records = records_by_header(file);
  const LayoutSet layouts = read_layouts(file, records);
  Bytes out;
  std::size_t copied = 0;
  for (const Record& record : records) {
    if (record.tag(file) != "SEGM") continue;
    const std::size_t payload = record.begin + kRecord;
    const Bytes repaired = ParsedSegment(record.payload(file), layouts).repaired();
    out.insert(out.end(), file.begin() + static_cast<std::ptrdiff_t>(copied),
               file.begin() + static_cast<std::ptrdiff_t>(payload));
    out.insert(out.end(), repaired.begin(), repaired.end());
    copied = record.end;
  }
  out.insert(out.end(), file.begin() + static_cast<std::ptrdiff_t>(copied), file.end());
  return out;
}

// Returns the index with the offsets, sizes and counts of the present segments, in their order
// (spec 5.1 to 5.3), or unchanged if it cannot be parsed. `shift` is added to the offsets.
Bytes repair_index(View file, View index, const std::vector<Record>& segments, std::size_t shift) {
  ByteReader in(index);
  ByteWriter out;
  std::size_t next = 0;
  std::uint64_t total = 0;
  const auto copy = [&] {
    const std::uint64_t v = in.varint();
    out.varint(v);
    return v;
  };
  const auto size = [&] {
    const std::uint64_t stated = in.varint();
    out.varint(next < segments.size() ? segments[next].payload(file).size() : stated);
    ++next;
  };
  in.varint();
  for (std::uint64_t m = copy(); in.ok() && m > 0; --m) {
    copy();
    copy();
  }
  for (std::uint64_t links = copy(); in.ok() && links > 0; --links) {
    for (int i = 0; i < 2; ++i) out.f64(in.f64());
    for (int i = 0; i < 3; ++i) copy();
  }
  for (std::uint64_t runs = copy(); in.ok() && runs > 0; --runs) {
    copy();
    for (int i = 0; i < 5; ++i) out.f64(in.f64());
    const std::uint64_t offset = in.varint();
    out.varint(next < segments.size() ? segments[next].begin + shift : offset);
    for (std::uint64_t n = copy(); in.ok() && n > 0; --n) {
      copy();
      const std::uint64_t shape = copy();
      for (std::uint64_t tier = 0; in.ok() && tier < shape / 4; ++tier) {
        std::uint64_t primitives = in.varint();
        if (next < segments.size())
          primitives = get<std::uint32_t>(segments[next].payload(file), 8);
        out.varint(primitives);
        total += primitives;
        size();
      }
      for (std::uint64_t tier = 0; shape % 2 == 1 && in.ok() && tier < shape / 4; ++tier) size();
      for (std::uint64_t r = shape / 2 % 2 == 1 ? copy() : 0; in.ok() && r > 0; --r) {
        copy();
        size();
      }
    }
  }
  if (!in.ok()) return {index.begin(), index.end()};
  out.bytes(in.bytes(in.left()));
  ByteWriter all;
  all.varint(total);
  all.bytes(out.view());
  return all.take();
}

Bytes with_repaired_index(Bytes file) {
  std::vector<Record> segments;
  const Record* index = nullptr;
  const std::vector<Record> records = records_by_header(file);
  for (const Record& record : records) {
    if (record.tag(file) == "INDX") index = &record;
    if (record.tag(file) == "SEGM") segments.push_back(record);
  }
  if (index == nullptr) return file;
  const View old = index->payload(file);
  Bytes repaired = repair_index(file, old, segments, 0);
  repaired = repair_index(file, old, segments, repaired.size() - old.size());
  const auto payload = file.begin() + static_cast<std::ptrdiff_t>(index->begin + kRecord);
  const auto end = file.begin() + static_cast<std::ptrdiff_t>(index->end);
  file.insert(file.erase(payload, end), repaired.begin(), repaired.end());
  return file;
}

void repair_header(Bytes& file, const std::vector<Record>& records, Repair repair) {
  if (repair == Repair::kSizes) {
    put<std::uint64_t>(file, 16, file.size());
    for (const Record& record : records) {
      if (record.tag(file) == "INDX") put(file, 24, static_cast<std::uint32_t>(record.end));
    }
  }
  put(file, 28, hash(View(file).first(28)));
}

Bytes encode(const Scene& scene, const WriteSettings& settings) {
  auto bytes = encode_scene(scene, settings);
  require(bytes.ok(), "seeds can be written");
  return std::move(*bytes);
}

}  // namespace

std::vector<Bytes> stgs_seeds() {
  WriteSettings lossless, quantised;
  quantised.profile = Profile::kQuantised;
  lossless.chunk_seconds = quantised.chunk_seconds = 0.2;
  std::vector<Bytes> out = {encode(testing::random_scene(1, 0, 30, 21), lossless),
                            encode(testing::random_scene(12, 1, 30, 21), lossless),
                            encode(testing::random_scene(12, 1, 30, 21), quantised),
                            encode(testing::random_scene(60, 3, 30, 22), quantised)};
  Scene parts = testing::random_scene(20, 0, 40, 23);
  parts.parts = {{-2, 19.5, 11, TickRange{0, 19}}, {19.5, 50, 9}};
  parts.importance.assign(20, 0.5f);
  parts.metadata.window = CaptureWindow{5, 100, 1, 2};
  parts.metadata.start_camera.emplace();
  parts.metadata.start_camera->width = 64;
  parts.metadata.start_camera->height = 48;
  parts.metadata.start_camera->fx = parts.metadata.start_camera->fy = 60;
  out.push_back(encode(parts, lossless));
  quantised.tiers = 1;
  out.push_back(encode(parts, quantised));
  if (check_profile(Profile::kDraco).ok()) {
    quantised.profile = Profile::kDraco;
    out.push_back(encode(parts, quantised));
    out.push_back(encode(testing::random_scene(60, 1, 30, 22), quantised));
  }
  return out;
}

std::vector<Unit> stgs_units(View file) {
  std::vector<Unit> out = {{0, std::min(kHeader, file.size())}};
  if (file.empty()) return {};
  for (const Record& record : records_by_length(file)) {
    out.push_back({record.begin, record.end});
    out.push_back({std::min(record.begin + kRecord, record.end), record.end});
  }
  return out;
}

Bytes repair_stgs(Bytes file, Repair repair) {
  if (repair == Repair::kNothing || file.size() < kHeader) return file;
  const bool sizes = repair == Repair::kSizes;
  if (sizes) file = with_repaired_index(with_repaired_segments(file));
  const std::vector<Record> records = sizes ? records_by_header(file) : records_by_length(file);
  for (const Record& record : records) {
    if (sizes) put<std::uint64_t>(file, record.begin + 8, record.payload(file).size());
  }
  for (const Record& record : records) {
    put(file, record.begin + 16, hash(record.payload(file)));
    put(file, record.begin + 20, hash(View(file).subspan(record.begin, 20)));
  }
  repair_header(file, records, repair);
  return file;
}

std::uint64_t stgs_memory(View input) {
  // The tables of the head, the complete scene, and two segments at a time.
  return 4 * kStgsLimits.max_memory + 32 * input.size() + (256 << 10);
}

}  // namespace stgs::fuzz
