// SPDX-License-Identifier: Apache-2.0
// Compares the CUDA segment decoder with the CPU decoder, bit for bit.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "catch.h"
#include "compare_decoders.h"
#include "fixtures/long_part.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/scene_file.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

void check_decode(const SceneReader& reader, bool with_sh, SegmentCounts& counts,
                  TimeOrigin origin = TimeOrigin::kPart) {
  CHECK(compare_decoders(reader, with_sh, origin, counts) == "");
}

void check_packed(const Scene& scene, const WriteSettings& settings, SegmentCounts& counts) {
  const auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  const auto reader = SceneReader::open(memory_source(*bytes));
  check(reader.status());
  check_decode(**reader, true, counts);
  check_decode(**reader, false, counts);
}

}  // namespace

TEST_CASE(
    "on every conformance file the CUDA decoder matches the CPU bit for bit or rejects the same "
    "segments") {
  const char* const path = std::getenv("STGS_VECTORS");
  const std::filesystem::path folder = path != nullptr ? path : "tests/conformance/vectors";
  REQUIRE(std::filesystem::is_directory(folder));
  int files = 0;
  SegmentCounts counts;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const auto reader = SceneReader::open(entry.path().string());
    if (!reader.ok()) continue;
    INFO(entry.path().filename().string());
    ++files;
    check_decode(**reader, true, counts);
  }
  std::printf("  %d files, %d intact segments, %d unreadable segments\n", files, counts.intact,
              counts.unreadable);
  CHECK(files > 60);
  CHECK(counts.intact > 60);
}

TEST_CASE("times far into a long part match the CPU bit for bit, from either origin") {
  const auto reader = SceneReader::open(memory_source(make_far_content(3000).far));
  check(reader.status());
  SegmentCounts counts;
  check_decode(**reader, true, counts, TimeOrigin::kPart);
  check_decode(**reader, true, counts, TimeOrigin::kRecord);
  CHECK(counts.intact > 10);
}

TEST_CASE(
    "the CUDA decoder matches the CPU bit for bit on scenes of every SH degree, coder and size") {
  SegmentCounts counts;
  for (int degree = 0; degree <= 3; ++degree) {
    const Scene scene = random_scene(20000 + 777 * static_cast<std::size_t>(degree), degree, 60, 7);
    WriteSettings settings;
    check_packed(scene, settings, counts);
    settings.profile = Profile::kQuantised;
    for (const double quality : {40.0, 85.0, 100.0}) {
      settings.quality = quality;
      check_packed(scene, settings, counts);
    }
    settings.own_layouts = true;
    check_packed(scene, settings, counts);
    settings.own_layouts = false;
    settings.coder = SceneCoder::kBytes;
    check_packed(scene, settings, counts);
  }
  const Scene large = random_scene(300000, 0, 60, 8);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  settings.chunk_seconds = 1000;
  check_packed(large, settings, counts);
  std::printf("  %d segments of packed scenes\n", counts.intact);
}
