// SPDX-License-Identifier: Apache-2.0
// Reading does no work, and holds no memory, beyond what the bytes need.
#include <map>

#include "catch.h"
#include "codec/layout.h"
#include "container/segment_times.h"
#include "head_fixture.h"
#include "scene/reader_lists.h"

using namespace stgs;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint64_t kBodyEnd = std::uint64_t{1} << 40;

// Returns runs of segments with several tiers, with and without SH and further records.
IndexNode many_tiers(int runs) {
  IndexNode node;
  std::uint64_t at = 1000;
  const auto place = [&](RecordRange& record, std::uint64_t bytes) {
    record = {at, kRecordHeaderBytes + bytes};
    at += record.bytes;
  };
  for (int r = 0; r < runs; ++r) {
    IndexRun& run = node.runs.emplace_back();
    run.part = {static_cast<std::uint32_t>(r), 0, 300, {0, 300}, 1};
    for (std::uint32_t slot = 0; slot < 50; ++slot) {
      const std::size_t first = node.segments.size();
      for (int tier = 0; tier < 7; ++tier) {
        IndexEntry base;
        base.slot = slot;
        base.layer = layer_of(Content::kPrimitives, tier);
        base.primitives = 200;
        place(base, 500);
        node.segments.push_back({base, {}, 0, slot});
      }
      for (std::size_t i = first; slot % 2 == 1 && i < node.segments.size(); ++i)
        place(node.segments[i].sh, 1);
      if (slot % 5 != 0) continue;
      IndexEntry other;
      other.slot = slot;
      other.layer = 0x4000;
      place(other, 200);
      node.further.push_back({other, 0, slot});
    }
    run.segments = 350;
    run.further = 10;
    run.count = 50;
  }
  return node;
}

// Counts the reads of another source.
class CountingSource final : public ByteSource {
 public:
  explicit CountingSource(Bytes bytes) : source_(memory_source(std::move(bytes), "x.stgs")) {}
  std::uint64_t size() const override { return source_->size(); }
  const std::string& name() const override { return source_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    ++reads;
    return source_->read(offset, out);
  }
  mutable std::size_t reads = 0;

 private:
  std::unique_ptr<ByteSource> source_;
};

// Returns a growing file of a head and `count` times the bytes of `one`.
Bytes recording_of(std::size_t count, const Bytes& one) {
  FileMetadata metadata;
  metadata.scene.frames = 1;
  Bytes out = testing::growing_head(metadata);
  for (std::size_t i = 0; i < count; ++i) out.insert(out.end(), one.begin(), one.end());
  return out;
}

}  // namespace

TEST_CASE("the segments of a node are counted before they are read, so that no list grows") {
  const IndexNode node = many_tiers(3);
  ByteWriter out;
  write_node(node, out);
  FileHead head;
  Findings findings;
  ByteReader in(out.view());
  IndexNode read;
  REQUIRE(parse_node(in, {0, 24, 100, kBodyEnd}, head, read, findings));
  REQUIRE(read.runs.size() == 3);
  for (const IndexRun& run : read.runs) {
    CHECK(run.segments == 350);
    CHECK(run.further == 10);
  }
  CHECK(read.segments.size() == 3 * 350);
  CHECK(read.segments.capacity() == 3 * 350);
}

TEST_CASE("the segments of the first node are not copied") {
  IndexNode node = many_tiers(2);
  const SegmentEntry* const first = node.segments.data();
  FileHead head;
  head.available_bytes = kBodyEnd;
  Findings findings;
  REQUIRE(add_node(std::move(node), 0, 0, head.walk.pending.end(), head, findings));
  CHECK(head.index.segments.data() == first);
}

TEST_CASE("a listed segment replaces the further records of all parts") {
  FileHead head;
  head.parts.resize(2);
  head.index.further.emplace_back().part = 1;
  replace_segments(ListedSegment{}, {}, head);
  CHECK(head.parts.size() == 1);
  CHECK(head.index.further.empty());
  CHECK(head.index.segments.size() == 1);
}

TEST_CASE("a node that states more segments than it has reserves no memory for them") {
  ByteWriter out;
  write_node(many_tiers(1), out);
  for (std::size_t cut = 0; cut < out.size(); cut += 7) {
    FileHead head;
    Findings findings;
    ByteReader in(out.view().first(cut));
    IndexNode read;
    CHECK_FALSE(parse_node(in, {0, 24, 100, kBodyEnd}, head, read, findings));
    CHECK(read.segments.capacity() <= cut / 2);
  }
  // Two bytes for each of 2^30 segments.
  ByteWriter huge;
  huge.varint(0);
  huge.varint(1);
  huge.varint(0);
  for (const double v : {0.0, 300.0, 0.0, 300.0, 1.0}) huge.f64(v);
  huge.varint(1000);
  huge.varint(std::uint64_t{1} << 30);
  for (int i = 0; i < 1000; ++i) huge.varint(0x3FF);
  FileHead head;
  Findings findings;
  ByteReader in(huge.view());
  IndexNode read;
  CHECK_FALSE(parse_node(in, {0, 24, 100, kBodyEnd}, head, read, findings));
  CHECK(read.segments.capacity() <= huge.size());
}

TEST_CASE("segments that are needed at the same times are found together") {
  std::vector<SegmentInfo> segments(140'000);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    SegmentInfo& segment = segments[i];
    segment.begin_ticks = i < 70'000 ? 0 : 10;
    segment.end_ticks = segment.begin_ticks + (i % 70'000 < 100 ? 5 : 20);
    if (i == 50) segment.end_ticks = -1;  // not needed
  }
  const SegmentTimes times(segments, 30);
  for (const double at : {0.0, 4.0, 5.0, 9.0, 10.0, 16.0, 25.0}) {
    std::vector<std::uint32_t> expected;
    for (std::uint32_t i = 0; i < segments.size(); ++i) {
      if (segments[i].begin_ticks <= at && at < segments[i].end_ticks) expected.push_back(i);
    }
    CHECK(times.between(at, at) == expected);
  }
}

TEST_CASE("the search for fragments reads each byte in a few large pieces") {
  for (const std::size_t payload : {0, 8, 60}) {
    const Bytes record = write_record(kFragmentTag, Bytes(payload));
    const CountingSource source(recording_of(20'000, record));
    FileHead head;
    Findings findings;
    REQUIRE(read_head(source, {}, IndexLoading::kComplete, head, findings));
    // Not one for each record: windows of 64 KiB to 4 MiB, and records at their ends.
    CHECK(source.reads < 30);
  }
}

TEST_CASE("findings without texts have the same codes") {
  Findings silent(Findings::Texts::kNone);
  silent.error(IssueNumber::kFragment, 5, "{} is invalid", "it");
  CHECK_FALSE(silent.ok());
  CHECK(silent.code() == StatusCode::kInvalidFile);
  CHECK(silent.take().empty());
  Findings limit(Findings::Texts::kNone);
  limit.unsupported(IssueNumber::kMemoryLimit, 5, "too much");
  CHECK(limit.code() == StatusCode::kUnsupported);
  CHECK(limit.status("x").message() == "x: too much (byte 5, issue 308)");
}

TEST_CASE("reading layouts makes no lookups, which take 16 KiB each") {
  RansTable table;
  table.frequency[0] = table.frequency[1] = kRansTotal / 2;
  LayoutSet written;
  written.tables.assign(200, table);
  written.tables[7].frequency = {};
  written.tables[7].frequency[9] = kRansTotal;
  written.layouts.resize(1);
  ByteWriter out;
  write_layouts(written, out);
  LayoutSet set;
  Findings findings;
  ByteReader in(out.view());
  REQUIRE(parse_layouts(in, 0, kMaxTables, 1, 1 << 30, set, findings));
  CHECK(set.tables == written.tables);
  for (std::size_t t = 0; t < set.tables.size(); ++t) CHECK(set.only[t] == (t == 7 ? 9 : -1));
  CHECK(set.lookups.empty());
  make_lookups(set);
  CHECK(set.lookups.empty());  // no plane uses a table
}

namespace {

// A source of `stated` bytes: those of `bytes`, then zeros, of which reads fail beyond `served`.
class StatedSource final : public ByteSource {
 public:
  StatedSource(Bytes bytes, std::uint64_t stated, std::uint64_t served)
      : bytes_(std::move(bytes)), stated_(stated), served_(served) {}
  std::uint64_t size() const override { return stated_; }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    if (offset + out.size() > served_) {
      largest = std::max<std::uint64_t>(largest, out.size());
      return io_error("no more bytes");
    }
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = offset + i < bytes_.size() ? bytes_[offset + i] : std::uint8_t{0};
    read_bytes += out.size();
    return {};
  }
  void grow(std::uint64_t bytes) { served_ = stated_ += bytes; }
  mutable std::uint64_t largest = 0, read_bytes = 0;

 private:
  const std::string name_ = "x.stgs";
  Bytes bytes_;
  std::uint64_t stated_, served_;
};

}  // namespace

TEST_CASE("memory is allocated as bytes arrive, whatever size a source states") {
  FileHeader header;
  header.file_bytes = kBodyEnd;
  header.head_bytes = 0xFFFFFFF0;
  const StatedSource source(write_header(header), kBodyEnd, 1 << 16);
  Findings findings;
  FileHead head;
  CHECK_FALSE(read_head(source, {std::uint64_t{200'000'000}, std::uint64_t{8} << 30},
                        IndexLoading::kOnDemand, head, findings));
  CHECK(source.largest <= 8 << 20);
}

TEST_CASE("bytes of a growing file that were searched in vain are not searched again") {
  StatedSource source(recording_of(3, Bytes()), 64 << 20, 64 << 20);
  Findings findings;
  FileHead head;
  REQUIRE(read_head(source, {}, IndexLoading::kOnDemand, head, findings));
  const std::uint64_t once = source.read_bytes;
  for (int k = 0; k < 100; ++k) {
    source.grow(1);
    bool grown = false;
    REQUIRE(read_growth(source, head, grown, findings));
    CHECK_FALSE(grown);
  }
  CHECK(source.read_bytes < 2 * once);
}
