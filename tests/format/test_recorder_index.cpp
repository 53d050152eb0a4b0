// SPDX-License-Identifier: Apache-2.0
// The index of recordings: the number of reads to find it, and the effect of damaged fragments.
#include <set>

#include "catch.h"
#include "fixtures/recording_fixture.h"
#include "head_fixture.h"
#include "scene/recording.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;

TEST_CASE("a fragment of a long recording has few links") {
  const TemporaryFolder folder;
  const std::string path = folder / "long.stgs";
  record(path, 300, false, Profile::kQuantised, 4);
  const auto reader = open_scene(path);
  CHECK(reader->parts().size() == 300);
  CHECK(reader->primitives() == 1200);
  // 300 = 256 + 2 * 16 + 12.
  const Bytes intact = bytes_of(path);
  CHECK(head_of(intact).last_fragment->earlier.size() == 1 + 2 + 11);
  // Its 1,200 primitives are too few for the work that a validator does for a file of this size.
  const auto issues = validate_scene(*memory_source(intact));
  REQUIRE(issues.ok());
  CHECK(issues->size() == 1);
  CHECK(issues->front().number == 308);
  CHECK(issues_of(intact).empty());
  // Without its last byte, the previous fragment is found.
  const Bytes cut(intact.begin(), intact.end() - 1);
  CHECK((*SceneReader::open(memory_source(cut)))->parts().size() == 299);
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
  Bytes out = stgs::testing::growing_head(metadata);
  const Bytes head = out;
  FragmentLinks links;
  for (std::uint32_t i = 1; i <= count; ++i) {
    out.insert(out.end(), note.begin(), note.end());
    FragmentRecord fragment;
    fragment.frames = i;
    fragment.offset = out.size();
    fragment.head = head;
    links.take(fragment);
    const Bytes record = write_fragment(fragment);
    fragment.end = fragment.offset + record.size();
    links.add(fragment);
    out.insert(out.end(), record.begin(), record.end());
  }
  return out;
}

}  // namespace

TEST_CASE("the last fragment of a recording is found in few reads, wherever the file ends") {
  const Bytes note = write_record(tag_of("POSE"), Bytes(1000, 7), 0);
  const Bytes intact = long_recording(5000, note);
  for (const std::size_t tail : {0u, 1u, 40u, 100'000u, 3'000'000u}) {
    // The beginning of a record that is still being written.
    Bytes bytes = intact;
    const Bytes next = write_record(kSegmentTag, Bytes(4'000'000, 3));
    bytes.insert(bytes.end(), next.begin(), next.begin() + static_cast<std::ptrdiff_t>(tail));
    CountedSource::Counts counts;
    const CountedSource source(bytes, counts);
    Findings findings;
    FileHead head;
    REQUIRE(read_head(source, {}, IndexLoading::kOnDemand, head, findings));
    CHECK(findings.take().empty());
    CHECK(head.metadata.scene.frames == 5000);
    CHECK(head.header.file_bytes == intact.size());
    CHECK(head.index_bytes < 16384);
    CHECK(counts.reads < 20);
    CHECK(counts.bytes < 2 * tail + 100'000);
    // Every fragment is linked to.
    REQUIRE(load_index(source, 0, 5000, head, findings));
    CHECK(findings.take().empty());
    CHECK(head.walk.followed.size() == 5000);
  }
}

TEST_CASE("a damaged fragment affects only the segments that it lists") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  constexpr std::size_t kCount = 18;  // the sixteenth has the links of those before
  const auto sizes = record(path, kCount, false, Profile::kLossless, 6);
  const Bytes intact = bytes_of(path);
  const std::string text(intact.begin(), intact.end());
  for (std::size_t i = 0; i < kCount; ++i) {
    const std::size_t at = text.rfind("FRAG", sizes[i + 1]);
    for (const std::size_t byte : {5u, 40u, 110u}) {  // record header, frames, head
      Bytes damaged = intact;
      damaged[at + byte] ^= 0x10;
      const auto reader = SceneReader::open(memory_source(damaged));
      INFO("fragment " << i + 1 << ": " << reader.status().message());
      REQUIRE(reader.ok());
      CHECK((*reader)->parts().size() == kCount - 1);
      CHECK((*reader)->decode(0).ok());
      CHECK_FALSE(issues_of(damaged).empty());
      CHECK((*reader)->damage().size() == 1);
    }
  }
}

TEST_CASE(
    "a changed byte of the last fragment is damage, a missing one is a record being written") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  record(path, 2, false, Profile::kLossless, 6);
  const Bytes intact = bytes_of(path);
  const std::size_t last = std::string(intact.begin(), intact.end()).rfind("FRAG");
  for (std::size_t at = last; at < intact.size(); ++at) {
    Bytes damaged = intact;
    damaged[at] ^= 0x10;
    const auto reader = SceneReader::open(memory_source(damaged));
    REQUIRE(reader.ok());
    CHECK((*reader)->parts().size() == 1);
    if ((*reader)->damage().size() != 1) FAIL("byte " << at - last);
    const auto cut = SceneReader::open(
        memory_source(Bytes(intact.begin(), intact.begin() + static_cast<std::ptrdiff_t>(at))));
    REQUIRE(cut.ok());
    if (!(*cut)->damage().empty()) FAIL("cut at byte " << at - last);
  }
}

namespace {

// Appends `count` headers of FRAG records, kFakeBytes apart, whose payloads end with the file.
constexpr std::size_t kFakeBytes = 40;
void append_fakes(std::size_t count, Bytes& bytes) {
  const std::size_t first = bytes.size(), end = first + count * kFakeBytes;
  bytes.resize(end);
  for (std::size_t at = first; at < end; at += kFakeBytes) {
    ByteWriter out;
    out.u32(kFragmentTag);
    out.u32(kCritical);
    out.u64(end - at - kRecordHeaderBytes);
    out.u32(0);
    out.u32(checksum(out.view()));
    std::copy(out.view().begin(), out.view().end(),
              bytes.begin() + static_cast<std::ptrdiff_t>(at));
  }
}

// Appends a fragment with these links.
void append_fragment(std::vector<NodeLink> links, std::vector<NodeLink> earlier, Bytes& bytes) {
  FragmentRecord fragment;
  fragment.frames = 5;
  fragment.offset = bytes.size();
  fragment.head.assign(
      bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(intact_header(bytes)->head_bytes));
  fragment.node.links = std::move(links);
  fragment.earlier = std::move(earlier);
  const Bytes record = write_fragment(fragment);
  bytes.insert(bytes.end(), record.begin(), record.end());
}

Result<std::unique_ptr<SceneReader>> open_counted(const Bytes& bytes,
                                                  CountedSource::Counts& counts) {
  return SceneReader::open(std::make_unique<CountedSource>(bytes, counts));
}

}  // namespace

// conformance 1.5
TEST_CASE("searches for fragments read a recording a few times, whatever it contains") {
  Bytes bytes = long_recording(1, {});
  append_fakes(20000, bytes);
  CountedSource::Counts counts;
  const auto reader = open_counted(bytes, counts);
  REQUIRE(reader.ok());
  CHECK((*reader)->metadata().frames == 1);
  CHECK(counts.bytes < 4 * bytes.size());
}

TEST_CASE("links to fragments that overlap are followed for as many bytes as the file has") {
  Bytes bytes = long_recording(1, {});
  constexpr std::size_t kCount = 10000;
  const std::size_t first = bytes.size();
  append_fakes(kCount, bytes);
  std::vector<NodeLink> links;
  for (std::size_t at = first; at < bytes.size(); at += kFakeBytes)
    links.push_back({{0, 1}, at, 0, bytes.size() - at - kRecordHeaderBytes});
  append_fragment(links, {}, bytes);
  CountedSource::Counts counts;
  const auto reader = open_counted(bytes, counts);
  CHECK(reader.status().code() == StatusCode::kUnsupported);
  CHECK(reader.status().message().find("issue 308") != std::string::npos);
  CHECK(counts.bytes < 4 * bytes.size());
}

TEST_CASE("a fragment that is followed instead of many is read once") {
  Bytes bytes = long_recording(1, {});
  const std::size_t first = bytes.size();
  const std::uint64_t body = intact_header(bytes)->head_bytes;
  append_fragment({}, std::vector<NodeLink>(20000, {{0, 1}, body, 0, 10}), bytes);
  const std::size_t gap = bytes.size();
  bytes.resize(gap + 10000);
  std::vector<NodeLink> links;
  for (std::size_t i = 0; i < 2000; ++i) links.push_back({{0, 1}, gap + 5 * i, 0, 10});
  append_fragment(links, {}, bytes);
  REQUIRE(gap - first > bytes.size() / 2);
  CountedSource::Counts counts;
  const auto reader = open_counted(bytes, counts);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK_FALSE((*reader)->damage().empty());
  CHECK(counts.bytes < 4 * bytes.size());
}

TEST_CASE("a fragment that was cut off at a search is found when the recording grows") {
  Bytes bytes = long_recording(3, {});
  const Bytes cut(bytes.begin(), bytes.end() - 30);
  bytes.push_back(0);
  const auto reader = SceneReader::open(memory_source(cut));
  REQUIRE(reader.ok());
  CHECK((*reader)->metadata().frames == 2);
  const auto grown = (*reader)->refreshed(memory_source(bytes));
  INFO(grown.status().message());
  REQUIRE(grown.ok());
  CHECK((*grown)->metadata().frames == 3);
}
