// SPDX-License-Identifier: Apache-2.0
// The index of recordings: the number of reads to find it, and the effect of damaged fragments.
#include <set>

#include "catch.h"
#include "fixtures/recording_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;

TEST_CASE("the index of a long recording is found with few fragments") {
  const TemporaryFolder folder;
  const std::string path = folder / "long.stgs";
  const std::vector<std::uint64_t> sizes = record(path, 200, false, Profile::kQuantised, 4);
  const auto reader = open_scene(path);
  CHECK(reader->parts().size() == 200);
  CHECK(reader->primitives() == 800);
  // 200 = 128 + 64 + 8.
  CHECK(reader->head_bytes() < sizes.front() + 3 * 230 + 200 * 60);
  // Without its last byte, the previous fragment is found.
  const Bytes intact = bytes_of(path);
  const Bytes cut(intact.begin(), intact.end() - 1);
  CHECK((*SceneReader::open(memory_source(cut)))->parts().size() == 199);
}

namespace {

// Counts the reads of a source and their bytes.
class CountedSource final : public ByteSource {
 public:
  struct Counts {
    std::size_t reads = 0;
    std::uint64_t bytes = 0;
  };
  CountedSource(Bytes bytes, Counts& counts)
      : source_(memory_source(std::move(bytes))), counts_(counts) {}
  std::uint64_t size() const override { return source_->size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    ++counts_.reads;
    counts_.bytes += out.size();
    return source_->read(offset, out);
  }
  const std::string& name() const override { return source_->name(); }

 private:
  std::unique_ptr<ByteSource> source_;
  Counts& counts_;
};

// A recording of `count` fragments without primitives; `note` precedes each fragment record.
Bytes long_recording(std::uint32_t count, const Bytes& note) {
  FileMetadata metadata;
  metadata.scene = recording_metadata();
  metadata.scene.frames = 1;
  const Bytes meta = write_record(kMetadataTag, write_metadata(metadata));
  FileHeader header;
  header.flags = kGrowing;
  header.head_bytes = kHeaderBytes + meta.size();
  Bytes out = write_header(header);
  out.insert(out.end(), meta.begin(), meta.end());
  FragmentHeader fragment;
  fragment.head = checksum(out);
  std::vector<PartEntry> parts;
  std::vector<std::uint64_t> offsets;
  std::uint64_t last_bytes = 0;
  FileIndex index;
  index.chunk_ticks = 1;
  for (std::uint32_t i = 1; i <= count; ++i) {
    out.insert(out.end(), note.begin(), note.end());
    parts.push_back({i - 1.0, 1.0 * i, last_bytes + note.size()});
    const std::size_t first = i & (i - 1);
    fragment.frames = i;
    fragment.offset = out.size();
    fragment.previous = first > 0 ? offsets[first - 1] : 0;
    fragment.before = offsets.empty() ? 0 : offsets.back();
    offsets.push_back(out.size());
    const Bytes record =
        write_fragment(fragment, write_index(index, std::span(parts).subspan(first)));
    last_bytes = record.size();
    out.insert(out.end(), record.begin(), record.end());
  }
  return out;
}

}  // namespace

TEST_CASE("a recording of 20,000 fragments is opened in few reads, wherever it ends") {
  const Bytes note = write_record(tag_of("POSE"), Bytes(1000, 7), 0);
  const Bytes intact = long_recording(20000, note);
  REQUIRE(intact.size() > 20'000'000);
  for (const std::size_t tail : {0u, 1u, 40u, 100'000u, 3'000'000u}) {
    // The beginning of a record that is still being written.
    Bytes bytes = intact;
    const Bytes next = write_record(kSegmentTag, Bytes(4'000'000, 3));
    bytes.insert(bytes.end(), next.begin(), next.begin() + static_cast<std::ptrdiff_t>(tail));
    CountedSource::Counts counts;
    const auto reader = SceneReader::open(std::make_unique<CountedSource>(bytes, counts));
    INFO(reader.status().message());
    REQUIRE(reader.ok());
    CHECK((*reader)->parts().size() == 20000);
    CHECK((*reader)->incomplete_bytes() == tail);
    CHECK((*reader)->damage().empty());
    CHECK(counts.reads < 40);
    CHECK(counts.bytes < (*reader)->head_bytes() + 2 * tail + 100'000);
  }
}

TEST_CASE("a damaged fragment affects only the segments that no other fragment lists") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  record(path, 13, false, Profile::kLossless, 6);
  const Bytes intact = bytes_of(path);
  std::vector<std::size_t> at;
  const std::string text(intact.begin(), intact.end());
  for (std::size_t i = text.find("FRAG"); i != std::string::npos; i = text.find("FRAG", i + 1)) {
    at.push_back(i);
  }
  REQUIRE(at.size() == 13);
  for (std::size_t i = 0; i < at.size(); ++i) {
    for (const std::size_t byte : {5, 40, 110}) {  // record header, fragment header, index
      Bytes damaged = intact;
      damaged[at[i] + byte] ^= 0x10;
      const auto reader = SceneReader::open(memory_source(damaged));
      INFO("fragment " << i + 1 << ": " << reader.status().message());
      REQUIRE(reader.ok());
      CHECK((*reader)->parts().size() >= (i == 12 || (i == 11 && byte < 32) ? 11 : 12));
      const auto set = (*reader)->decode(0);
      CHECK(set.ok());
      CHECK_FALSE(issues_of(damaged).empty());
      // Fragments 8, 12 and 13 form the chain; a damaged 13 counts as not yet written.
      CHECK((*reader)->damage().size() == (i == 7 || (i == 11 && byte >= 32) ? 1 : 0));
    }
  }
}

TEST_CASE("records that resemble fragments cause a bounded number of bytes read") {
  Bytes bytes = long_recording(1, {});
  const std::size_t head = bytes.size();
  // Each states a length up to the end of the file.
  constexpr std::size_t kFakeCount = 20000, kSize = 40;
  bytes.resize(head + kFakeCount * kSize + 100);
  for (std::size_t i = 0; i < kFakeCount; ++i) {
    const std::size_t offset = head + i * kSize;
    ByteWriter out;
    out.u32(kFragmentTag);
    out.u32(kCritical);
    out.u64(bytes.size() - offset - kRecordHeaderBytes);
    out.u64(0);
    out.u64(checksum(out.view()));
    std::copy(out.view().begin(), out.view().end(),
              bytes.begin() + static_cast<std::ptrdiff_t>(offset));
  }
  CountedSource::Counts counts;
  const auto reader = SceneReader::open(std::make_unique<CountedSource>(bytes, counts));
  CHECK((reader.ok() || reader.status().code() == StatusCode::kInvalidFile));
  CHECK(counts.bytes < 8 * bytes.size() + 20'000'000);
}
