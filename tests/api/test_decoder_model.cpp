// SPDX-License-Identifier: Apache-2.0
// What a file asks of a decoder (spec/decoder-model.md), against looking at every moment.
#include <algorithm>
#include <fstream>
#include <sstream>

#include "catch.h"
#include "scene_fixture.h"
#include "stgs/format/decoder_model.h"

using namespace stgs;
using stgs::testing::random_scene;

namespace {

std::unique_ptr<SceneReader> written(std::size_t n, std::uint32_t frames, double chunk_seconds,
                                     bool in_parts, bool own_layouts = false) {
  Scene scene = random_scene(n, 1, frames, 4);
  if (in_parts) {
    scene.parts = {{0, 0.6 * frames, n / 2}, {0.5 * frames, double(frames), n - n / 2}};
  }
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = chunk_seconds;
  settings.own_layouts = own_layouts;
  const auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(*bytes));
  REQUIRE(reader.ok());
  return std::move(*reader);
}

}  // namespace

TEST_CASE("what is held, and the rate, are those of the moment that has most") {
  for (const bool in_parts : {false, true}) {
    const auto reader = written(6000, 300, 0.2, in_parts);
    const DecoderNeeds needs = decoder_needs(*reader);
    DecoderNeeds most;
    for (double t = 0; t <= 300; t += 0.125) {
      DecoderNeeds here;
      std::uint32_t before = 0xFFFFFFF0;
      for (const std::uint32_t s : reader->segments_between(t, t)) {
        const SegmentInfo& segment = reader->segments()[s];
        here.primitives += segment.primitives;
        here.bytes += segment.bytes + segment.sh_bytes;
        here.ranges += s == before + 1 ? 0 : 1;
        before = s;
      }
      most.primitives = std::max(most.primitives, here.primitives);
      most.bytes = std::max(most.bytes, here.bytes);
      most.ranges = std::max(most.ranges, here.ranges);
    }
    CHECK(needs.primitives == most.primitives);
    CHECK(needs.bytes == most.bytes);
    CHECK(needs.ranges == most.ranges);
    CHECK(needs.decoded_bytes == most.primitives * 4 * (17 + 12));
    CHECK(needs.index_bytes == reader->head_bytes());
    CHECK(needs.level == 1);

    // At that rate each segment has come when it begins, and the one that sets it no earlier.
    std::vector<SegmentInfo> segments = reader->segments();
    std::stable_sort(segments.begin(), segments.end(),
                     [](const auto& a, const auto& b) { return a.begin_ticks < b.begin_ticks; });
    double bits = 0, primitives = 0, slack = 1e30, work_slack = 1e30;
    std::uint64_t startup = needs.index_bytes;
    for (const SegmentInfo& segment : segments) {
      const auto bytes = segment.bytes + segment.sh_bytes;
      if (segment.begin_ticks <= 30.0) {
        startup += bytes;
        continue;
      }
      bits += 8.0 * static_cast<double>(bytes);
      primitives += std::max(segment.primitives, 1000u);
      slack = std::min(slack, segment.begin_ticks / 30.0 - bits / needs.bits_per_second);
      work_slack = std::min(work_slack,
                            segment.begin_ticks / 30.0 - primitives / needs.primitives_per_second);
    }
    CHECK(startup == needs.startup_bytes);
    CHECK(slack == Approx(0.0).margin(1e-9));
    CHECK(work_slack == Approx(0.0).margin(1e-9));
  }
}

TEST_CASE("the tables that records can have of their own count as work") {
  const auto reader = written(6000, 300, 0.2, false, true);
  const DecoderNeeds needs = decoder_needs(*reader);
  double most = 0;
  for (const SegmentInfo& last : reader->segments()) {
    double work = 0;
    for (const SegmentInfo& segment : reader->segments()) {
      if (segment.begin_ticks <= 30.0 || segment.begin_ticks > last.begin_ticks) continue;
      work += std::max(segment.primitives, 1000u);
      for (const std::uint64_t bytes : {segment.bytes, segment.sh_bytes}) {
        work += 64.0 * static_cast<double>(std::min<std::uint64_t>(256, bytes / 3));
      }
    }
    if (last.begin_ticks > 30.0) most = std::max(most, work / (last.begin_ticks / 30.0));
  }
  CHECK(needs.primitives_per_second == Approx(most));
  CHECK(most > 2 * decoder_needs(*written(6000, 300, 0.2, false)).primitives_per_second);
}

TEST_CASE("a clip of one segment asks for itself alone") {
  const auto reader = written(100, 20, 10.0, false);
  const DecoderNeeds needs = decoder_needs(*reader);
  CHECK(needs.primitives == reader->primitives());
  CHECK(needs.ranges == 1);
  CHECK(needs.bits_per_second == 0.0);
  CHECK(needs.primitives_per_second == 0.0);
  const SegmentInfo& last = reader->segments().back();
  CHECK(needs.startup_bytes == std::max(last.offset + last.bytes, last.sh_offset + last.sh_bytes));
}

TEST_CASE("the levels of the text are the program's") {
  std::ifstream file(std::string(STGS_TEST_DATA) + "/../../spec/decoder-model.md");
  std::ostringstream text;
  text << file.rdbuf();
  for (const char* row : {"| 1 | 250,000 | 4 MiB | 256 KiB | 10,000,000 | 1,000,000 |",
                          "| 2 | 1,000,000 | 16 MiB | 1 MiB | 25,000,000 | 4,000,000 |",
                          "| 3 | 4,000,000 | 64 MiB | 4 MiB | 100,000,000 | 16,000,000 |",
                          "| 4 | 16,000,000 | 256 MiB | 16 MiB | 400,000,000 | 64,000,000 |"}) {
    CHECK(text.str().find(row) != std::string::npos);
  }
}
