// SPDX-License-Identifier: Apache-2.0
#include "stgs_file.h"

#include <libdeflate.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <string_view>

#include "../fixtures/scene_fixture.h"
#include "codec/draco_points.h"
#include "codec/layout.h"
#include "core/bytes.h"

namespace stgs::fuzz {
namespace {

constexpr std::size_t kHeader = 32, kRecord = 24;  // spec 2.1, 3.1
constexpr std::size_t kMaxPlaneBytes = 1 << 20;    // larger segments keep their checksum
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

// Parses the payload of a SEGM record (spec 6.1) up to the end of its bytes.
class ParsedSegment {
 public:
  ParsedSegment(View payload, const LayoutSet& file_layouts) : in_(payload) {
    in_.bytes(8);
    n_ = in_.u32();
    std::uint16_t number = in_.u16();
    in_.u64();
    Findings findings;
    if (number == kOwnLayout) {
      if (!parse_layouts(in_, 0, kMaxOwnTables, kTablesMemory, own_, findings)) return;
      number = 0;
      set_ = &own_;
    } else {
      set_ = &file_layouts;
    }
    if (!in_.ok() || number >= set_->layouts.size()) return;
    if (set_->layouts[number].problem != 0) return;
    layout_ = &set_->layouts[number];
    if (layout_->has_first_key()) in_.u64();
    sizes_at_ = in_.position();
    for (const StreamRow& row : layout_->streams) sizes_.push_back(is_coded(row) ? 0 : in_.u64());
  }

  // Returns the offset of the last stated stream size and the size that fills the payload; false if
  // a group takes the remaining bytes.
  bool fill_last_stream(std::size_t& at, std::uint64_t& size) const {
    if (layout_ == nullptr || !in_.ok() || sizes_.empty() || layout_->has_group()) return false;
    std::uint64_t others = 0;
    for (std::size_t i = 0; i + 1 < sizes_.size(); ++i) others += sizes_[i];
    at = sizes_at_ + 8 * (sizes_.size() - 1);
    size = in_.left() - others;
    return others <= in_.left();
  }

  // Decodes the planes that the checksum of the record covers; returns false if they cannot be
  // decoded.
  bool planes(Bytes& out) {
    if (layout_ == nullptr || !in_.ok()) return false;
    std::vector<View> streams;
    for (const std::uint64_t size : sizes_) streams.push_back(in_.bytes(size));
    std::vector<RansGroupDecoder> group;
    if (layout_->has_group()) {
      auto opened = RansGroupDecoder::open(in_.bytes(in_.left()), n_);
      if (!opened.ok()) return false;
      group.push_back(std::move(*opened));
    }
    for (std::size_t i = 0; i < streams.size() && in_.ok(); ++i) {
      const StreamRow& row = layout_->streams[i];
      if (row.attribute >= kOptionalAttributes) continue;
      if (out.size() + n_ * row.planes() > kMaxPlaneBytes) return false;
      if (!is_coded(row)) {
        append_bytes(streams[i], n_, row, out);
        continue;
      }
      for (const std::uint16_t table : row.tables) {
        if (set_->only[table] >= 0) continue;
        out.resize(out.size() + n_);
        group[0].next_plane(set_->lookups[table], out.data() + out.size() - n_);
      }
    }
    return in_.ok();
  }

 private:
  static bool is_coded(const StreamRow& row) {
    return static_cast<Coder>(row.coder) == Coder::kRans;
  }
  // Streams that do not unpack count as zeros; readers reject them before the checksum.
  static void append_bytes(View stored, std::size_t n, const StreamRow& row, Bytes& out) {
    const std::size_t begin = out.size(), size = n * row.planes();
    out.resize(begin + size);
    if (static_cast<Coder>(row.coder) == Coder::kDraco) {
      if (size == 9 * n && draco_fits(stored, n))
        (void)draco_decode(stored, n, std::span(out).subspan(begin));
    } else if (stored.size() == size) {
      std::copy(stored.begin(), stored.end(), out.begin() + static_cast<std::ptrdiff_t>(begin));
    } else {
      ZSTD_decompress(out.data() + begin, size, stored.data(), stored.size());
    }
  }

  ByteReader in_;
  std::size_t n_ = 0, sizes_at_ = 0;
  LayoutSet own_;
  const LayoutSet* set_ = nullptr;
  const Layout* layout_ = nullptr;
  std::vector<std::uint64_t> sizes_;
};

LayoutSet read_layouts(View file, const std::vector<Record>& records) {
  LayoutSet set;
  for (const Record& record : records) {
    if (record.tag(file) != "LAYT") continue;
    ByteReader in(record.payload(file));
    Findings findings;
    LayoutSet parsed;
    if (parse_layouts(in, 0, kMaxTables, kTablesMemory, parsed, findings)) set = std::move(parsed);
  }
  return set;
}

// Repairs the checksum of the planes of a segment and the size of its last stream.
void repair_segment(Bytes& file, const Record& record, const LayoutSet& layouts, Repair repair) {
  const std::size_t payload = record.begin + kRecord;
  std::size_t at = 0;
  std::uint64_t size = 0;
  if (repair == Repair::kSizes &&
      ParsedSegment(record.payload(file), layouts).fill_last_stream(at, size)) {
    put(file, payload + at, size);
  }
  Bytes planes;
  if (ParsedSegment(record.payload(file), layouts).planes(planes)) {
    put<std::uint64_t>(file, payload + 14, hash(planes));
  }
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
  if (sizes) file = with_repaired_index(std::move(file));
  const std::vector<Record> records = sizes ? records_by_header(file) : records_by_length(file);
  for (const Record& record : records) {
    if (sizes) put<std::uint64_t>(file, record.begin + 8, record.payload(file).size());
  }
  const LayoutSet layouts = read_layouts(file, records);
  for (const Record& record : records) {
    if (record.tag(file) == "SEGM") repair_segment(file, record, layouts, repair);
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
