// SPDX-License-Identifier: Apache-2.0
// What of a damaged recording is kept, and what is told of the rest.
#include "container/container.h"
#include "recording_fixture.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

TEST_CASE("finalize leaves a stretch out that no sound record is left of") {
  const TemporaryFolder folder;
  const std::string path = folder / "torn.stgs", out = folder / "out.stgs";
  record(path, 4, false, Profile::kQuantised);
  Bytes bytes = bytes_of(path);
  // What they hold, but neither their headers nor their fragment, as a power cut can leave them.
  const auto reader = opened(path);
  std::uint64_t lost_bytes = 0, segments = 0;
  for (const SegmentInfo& segment : reader->segments()) {
    if (segment.part != 3) continue;
    ++segments;
    lost_bytes += segment.bytes + segment.sh_bytes;
    for (const auto& [at, size] : {std::pair(segment.offset, segment.bytes),
                                   std::pair(segment.sh_offset, segment.sh_bytes)}) {
      if (size == 0) continue;
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at + kRecordHeaderBytes),
                  size - kRecordHeaderBytes, std::uint8_t{0});
    }
  }
  DamageReport losses;
  REQUIRE(finalize_scene(memory_source(bytes, "torn.stgs"), out, losses).ok());
  CHECK(opened(out)->parts().size() == 3);
  CHECK(opened(out)->metadata().frames == 30);
  CHECK(issues_of(bytes_of(out)).empty());
  CHECK(losses.segments == segments);
  CHECK(losses.primitives == 60);
  CHECK(losses.bytes == lost_bytes);
  REQUIRE(losses.ranges.size() == 1);
  CHECK(losses.ranges[0].begin >= 30);
  CHECK(losses.ranges[0].end <= 40);
  const auto lines = describe_damage(losses, recording_metadata().time_base);
  REQUIRE(lines.size() == 1);
  CHECK(lines[0].find("(60 primitives)") != std::string::npos);
  CHECK(lines[0].find(fmt::format(": {} bytes, shown", lost_bytes)) != std::string::npos);
}

TEST_CASE("finalize keeps what is sound beside a damaged record, and the damage") {
  const TemporaryFolder folder;
  const std::string path = folder / "damaged.stgs", out = folder / "out.stgs";
  record(path, 4, false, Profile::kQuantised);
  const auto recorded = opened(path);
  for (const std::size_t stretch_hit : {1u, 2u}) {
    const auto segment =
        std::find_if(recorded->segments().begin(), recorded->segments().end(),
                     [&](const SegmentInfo& one) { return one.part == stretch_hit; });
    Bytes bytes = bytes_of(path);
    bytes[segment->offset + 100] ^= 0x20;
    DamageReport losses;
    REQUIRE(finalize_scene(memory_source(bytes, "damaged.stgs"), out, losses).ok());
    CHECK(losses.segments == 1);
    CHECK(losses.total_segments == recorded->segments().size());
    CHECK(losses.primitives == segment->primitives);
    CHECK(losses.bytes == segment->bytes + segment->sh_bytes);
    CHECK(losses.ranges == std::vector<TickRange>{{segment->begin_ticks, segment->end_ticks}});
    CHECK(losses.reason.code() == StatusCode::kInvalidFile);
    const auto finished = opened(out);
    CHECK(finished->parts() == recorded->parts());
    CHECK(issues_of(bytes_of(out)).count(112) == 1);
    for (std::uint32_t s = 0; s < finished->segments().size(); ++s) {
      const bool hit = &recorded->segments()[s] == &*segment;
      CHECK(finished->decode(s).ok() == !hit);
      if (!hit) CHECK(fingerprints(*finished->decode(s)) == fingerprints(*recorded->decode(s)));
    }
    // Converting or packing it goes on with the rest, and strict reading does not.
    DamageReport again;
    const auto sound = recover_scene(out, again);
    REQUIRE(sound.ok());
    CHECK(sound->gaussians.size() == recorded->primitives() - segment->primitives);
    CHECK(sound->parts[stretch_hit].primitives == 60 - segment->primitives);
    CHECK(again.primitives == segment->primitives);
    CHECK(again.bytes == losses.bytes);
    CHECK(again.ranges == losses.ranges);
    CHECK(read_scene(out).status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("finalize makes no file of a recording of which nothing can be read") {
  const TemporaryFolder folder;
  const std::string path = folder / "dead.stgs", out = folder / "out.stgs";
  record(path, 2, true);
  Bytes bytes = bytes_of(path);
  const auto reader = opened(path);
  for (const SegmentInfo& segment : reader->segments()) bytes[segment.offset + 60] ^= 1;
  DamageReport losses;
  CHECK(finalize_scene(memory_source(bytes, "dead.stgs"), out, losses).code() ==
        StatusCode::kInvalidFile);
  CHECK_FALSE(fs::exists(out));
  CHECK(recover_scene(memory_source(bytes, "dead.stgs"), losses).status().code() ==
        StatusCode::kInvalidFile);
}

TEST_CASE("what a damaged fragment of the index alone lists is told with its moments") {
  const std::string path =
      std::string(STGS_TEST_DATA) + "/../conformance/vectors/fragment_damaged.stgs";
  const auto reader = opened(path);
  REQUIRE(reader->lost_fragments().size() == 1);
  const LostFragment& lost = reader->lost_fragments()[0];
  CHECK(lost.range == TickRange{90, 100});
  CHECK(lost.bytes > 435);
  CHECK(reader->complete_ticks() == 90);
  const TemporaryFolder folder;
  DamageReport losses;
  REQUIRE(finalize_scene(std::move(*open_file(path)), folder / "out.stgs", losses).ok());
  CHECK(losses.lost_fragments == reader->lost_fragments());
  REQUIRE(losses.damage.size() >= 1);
  CHECK(losses.damage[0].number == 313);
  DamageReport read;
  REQUIRE(recover_scene(path, read).ok());
  const auto lines = describe_damage(read, reader->metadata().time_base);
  REQUIRE(lines.size() == 2);
  CHECK(lines[0].find("issue 313") != std::string::npos);
  CHECK(lines[1].find("content first shown 3.000 to 3.333 s is lost") != std::string::npos);
}

TEST_CASE("a fragment that a damaged one hides is told") {
  const TemporaryFolder folder;
  const std::string path = folder / "hidden.stgs";
  record(path, 3, true);
  Bytes bytes = bytes_of(path);
  const std::string text(bytes.begin(), bytes.end());
  const std::size_t third = text.rfind("FRAG", text.rfind("FRAG") - 1);
  bytes[third + 1] ^= 0x10;
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  CHECK((*reader)->metadata().frames == 20);
  CHECK((*reader)->unreached_frames() == 30);
  CHECK((*reader)->incomplete_bytes() > 0);
  const auto issues = validate_scene(*memory_source(bytes));
  REQUIRE(issues.ok());
  CHECK(std::any_of(issues->begin(), issues->end(), [](const Issue& issue) {
    return issue.number == 314 &&
           issue.message.find("with 30 frames that cannot be used") != std::string::npos &&
           issue.message.find("after frame 20 is not shown") != std::string::npos;
  }));
  CHECK(opened(path)->unreached_frames() == 0);
}
