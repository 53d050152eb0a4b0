// SPDX-License-Identifier: Apache-2.0
// The decoder model of a file (spec/decoder-model.md), compared with an exhaustive scan over time.
#include <algorithm>
#include <fstream>
#include <sstream>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/decoder_model.h"

using namespace stgs;
using stgs::testing::random_scene;

namespace {

std::unique_ptr<SceneReader> write_and_open(std::size_t n, std::uint32_t frames,
                                            double chunk_seconds, bool in_parts,
                                            bool own_layouts = false) {
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

TEST_CASE("resident data and rates are those of the most demanding time") {
  for (const bool in_parts : {false, true}) {
    const auto reader = write_and_open(6000, 300, 0.2, in_parts);
    const DecoderNeeds needs = decoder_needs(*reader);
    DecoderNeeds peak;
    for (double t = 0; t <= 300; t += 0.125) {
      DecoderNeeds current;
      std::uint32_t before = 0xFFFFFFF0;
      for (const std::uint32_t s : reader->segments_between(t, t)) {
        const SegmentInfo& segment = reader->segments()[s];
        current.primitives += segment.primitives;
        current.bytes += segment.bytes + segment.sh_bytes;
        current.ranges += s == before + 1 ? 0 : 1;
        before = s;
      }
      peak.primitives = std::max(peak.primitives, current.primitives);
      peak.bytes = std::max(peak.bytes, current.bytes);
      peak.ranges = std::max(peak.ranges, current.ranges);
    }
    CHECK(needs.primitives == peak.primitives);
    CHECK(needs.bytes == peak.bytes);
    CHECK(needs.ranges == peak.ranges);
    CHECK(needs.decoded_bytes == peak.primitives * 4 * (17 + 12));
    CHECK(needs.index_bytes == reader->head_bytes());
    CHECK(needs.level == 1);

    // At these rates every segment arrives before it begins, and the critical one just in time.
    std::vector<SegmentInfo> segments = reader->segments();
    std::stable_sort(segments.begin(), segments.end(),
                     [](const auto& a, const auto& b) { return a.begin_ticks < b.begin_ticks; });
    double bits = 0, primitives = 0, slack = 1e30, decode_slack = 1e30;
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
      decode_slack = std::min(
          decode_slack, segment.begin_ticks / 30.0 - primitives / needs.primitives_per_second);
    }
    CHECK(startup == needs.startup_bytes);
    CHECK(slack == Approx(0.0).margin(1e-9));
    CHECK(decode_slack == Approx(0.0).margin(1e-9));
  }
}

TEST_CASE("tables in a record count as decoding work") {
  const auto reader = write_and_open(6000, 300, 0.2, false, true);
  const DecoderNeeds needs = decoder_needs(*reader);
  double peak = 0;
  for (const SegmentInfo& last : reader->segments()) {
    double work = 0;
    for (const SegmentInfo& segment : reader->segments()) {
      if (segment.begin_ticks <= 30.0 || segment.begin_ticks > last.begin_ticks) continue;
      work += std::max(segment.primitives, 1000u);
      for (const std::uint64_t bytes : {segment.bytes, segment.sh_bytes}) {
        work += 64.0 * static_cast<double>(std::min<std::uint64_t>(256, bytes / 3));
      }
    }
    if (last.begin_ticks > 30.0) peak = std::max(peak, work / (last.begin_ticks / 30.0));
  }
  CHECK(needs.primitives_per_second == Approx(peak));
  CHECK(peak > 2 * decoder_needs(*write_and_open(6000, 300, 0.2, false)).primitives_per_second);
}

TEST_CASE("a clip of one segment requires only that segment") {
  const auto reader = write_and_open(100, 20, 10.0, false);
  const DecoderNeeds needs = decoder_needs(*reader);
  CHECK(needs.primitives == reader->primitives());
  CHECK(needs.ranges == 1);
  CHECK(needs.bits_per_second == 0.0);
  CHECK(needs.primitives_per_second == 0.0);
  const SegmentInfo& last = reader->segments().back();
  CHECK(needs.startup_bytes == std::max(last.offset + last.bytes, last.sh_offset + last.sh_bytes));
}

TEST_CASE("the levels in the specification match the program") {
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
