// SPDX-License-Identifier: Apache-2.0
// Damaged recordings: preserved content, and the report of the damage.
#include "container/container.h"
#include "fixtures/recording_fixture.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

TEST_CASE("finalize drops a fragment without any intact record") {
  const TemporaryFolder folder;
  const std::string path = folder / "torn.stgs", out = folder / "out.stgs";
  record(path, 4, false, Profile::kQuantised);
  Bytes bytes = bytes_of(path);
  // Zero the payloads, but not the record headers and the fragment, as after a power cut.
  const auto reader = open_scene(path);
  std::uint64_t damaged_bytes = 0, segments = 0;
  for (const SegmentInfo& segment : reader->segments()) {
    if (segment.part != 3) continue;
    ++segments;
    damaged_bytes += segment.bytes + segment.sh_bytes;
    for (const auto& [at, size] : {std::pair(segment.offset, segment.bytes),
                                   std::pair(segment.sh_offset, segment.sh_bytes)}) {
      if (size == 0) continue;
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at + kRecordHeaderBytes),
                  size - kRecordHeaderBytes, std::uint8_t{0});
    }
  }
  DamageReport report;
  REQUIRE(finalize_scene(memory_source(bytes, "torn.stgs"), out, report).ok());
  CHECK(open_scene(out)->parts().size() == 3);
  CHECK(open_scene(out)->metadata().frames == 30);
  CHECK(issues_of(bytes_of(out)).empty());
  CHECK(report.segments == segments);
  CHECK(report.primitives == 60);
  CHECK(report.bytes == damaged_bytes);
  REQUIRE(report.ranges.size() == 1);
  CHECK(report.ranges[0].begin >= 30);
  CHECK(report.ranges[0].end <= 40);
  const auto lines = describe_damage(report, recording_metadata().time_base);
  REQUIRE(lines.size() == 1);
  CHECK(lines[0].find("(60 primitives)") != std::string::npos);
  CHECK(lines[0].find(fmt::format(": {} bytes, needed", damaged_bytes)) != std::string::npos);
}

TEST_CASE("the description of much damage has a limited number of lines") {
  DamageReport report;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    Issue issue;
    issue.offset = i;
    LostFragment fragment;
    fragment.bytes = 10;
    report.damage.push_back(issue);
    report.lost_fragments.push_back(fragment);
  }
  const auto lines = describe_damage(report, {});
  REQUIRE(lines.size() == 42);
  CHECK(lines[20] == "980 further issues; 'stgs validate' lists them");
  CHECK(lines[41] == "980 further parts of the content are lost (9800 bytes)");
}

TEST_CASE("finalize preserves intact records, and the damaged one, of a fragment") {
  const TemporaryFolder folder;
  const std::string path = folder / "damaged.stgs", out = folder / "out.stgs";
  record(path, 4, false, Profile::kQuantised);
  const auto recorded = open_scene(path);
  for (const std::size_t damaged_part : {1u, 2u}) {
    const auto segment =
        std::find_if(recorded->segments().begin(), recorded->segments().end(),
                     [&](const SegmentInfo& info) { return info.part == damaged_part; });
    Bytes bytes = bytes_of(path);
    bytes[segment->offset + 100] ^= 0x20;
    DamageReport report;
    REQUIRE(finalize_scene(memory_source(bytes, "damaged.stgs"), out, report).ok());
    CHECK(report.segments == 1);
    CHECK(report.total_segments == recorded->segments().size());
    CHECK(report.primitives == segment->primitives);
    CHECK(report.bytes == segment->bytes + segment->sh_bytes);
    CHECK(report.ranges == std::vector<TickRange>{{segment->begin_ticks, segment->end_ticks}});
    CHECK(report.reason.code() == StatusCode::kInvalidFile);
    const auto finished = open_scene(out);
    CHECK(finished->parts() == recorded->parts());
    CHECK(issues_of(bytes_of(out)).count(112) == 1);
    for (std::uint32_t s = 0; s < finished->segments().size(); ++s) {
      const bool is_damaged = &recorded->segments()[s] == &*segment;
      CHECK(finished->decode(s).ok() == !is_damaged);
      if (!is_damaged)
        CHECK(fingerprints(*finished->decode(s)) == fingerprints(*recorded->decode(s)));
    }
    // Recovery continues with the rest; strict reading fails.
    DamageReport recovery;
    const auto recovered = recover_scene(out, recovery);
    REQUIRE(recovered.ok());
    CHECK(recovered->gaussians.size() == recorded->primitives() - segment->primitives);
    CHECK(recovered->parts[damaged_part].primitives == 60 - segment->primitives);
    CHECK(recovery.primitives == segment->primitives);
    CHECK(recovery.bytes == report.bytes);
    CHECK(recovery.ranges == report.ranges);
    CHECK(read_scene(out).status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("finalize writes no file if no primitive can be read") {
  const TemporaryFolder folder;
  const std::string path = folder / "dead.stgs", out = folder / "out.stgs";
  record(path, 2, true);
  Bytes bytes = bytes_of(path);
  const auto reader = open_scene(path);
  for (const SegmentInfo& segment : reader->segments()) bytes[segment.offset + 60] ^= 1;
  DamageReport report;
  CHECK(finalize_scene(memory_source(bytes, "dead.stgs"), out, report).code() ==
        StatusCode::kInvalidFile);
  CHECK_FALSE(fs::exists(out));
  CHECK(recover_scene(memory_source(bytes, "dead.stgs"), report).status().code() ==
        StatusCode::kInvalidFile);
}

TEST_CASE("content listed only by a damaged fragment is reported with its times") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto sizes = record(path, 12, false);
  Bytes bytes = bytes_of(path);
  bytes[sizes[10] - 20] ^= 1;  // in the record of the tenth fragment
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  REQUIRE((*reader)->lost_fragments().size() == 1);
  const LostFragment& lost = (*reader)->lost_fragments()[0];
  CHECK(lost.range == TickRange{90, 100});
  CHECK(lost.offset == sizes[9]);
  CHECK(lost.bytes > (sizes[10] - sizes[9]) / 2);
  CHECK((*reader)->complete_ticks() == 90);
  CHECK((*reader)->parts().size() == 11);
  DamageReport report;
  REQUIRE(finalize_scene(memory_source(bytes), folder / "out.stgs", report).ok());
  CHECK(report.lost_fragments == (*reader)->lost_fragments());
  REQUIRE(report.damage.size() == 1);
  CHECK(report.damage[0].number == 313);
  CHECK(issues_of(bytes_of(folder / "out.stgs")).empty());
  DamageReport read;
  REQUIRE(recover_scene(memory_source(bytes), read).ok());
  const auto lines = describe_damage(read, (*reader)->metadata().time_base);
  REQUIRE(lines.size() == 2);
  CHECK(lines[0].find("issue 313") != std::string::npos);
  CHECK(lines[1].find("content needed at 3.000 to 3.333 s is lost") != std::string::npos);
}
