// SPDX-License-Identifier: Apache-2.0
// The GPU's decoder of segments against the processor's, to the bit.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "catch.h"
#include "device_gaussians.h"
#include "scene_fixture.h"
#include "stgs/format/scene_file.h"

using namespace stgs;
using namespace stgs::testing;
using player::cuda::DeviceGaussians;
using player::cuda::SegmentDecoder;

namespace {

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

bool same_bits(Gaussians4D a, Gaussians4D b) {
  const auto of_a = OnDeviceGaussians::arrays(a), of_b = OnDeviceGaussians::arrays(b);
  for (std::size_t k = 0; k < of_a.size(); ++k) {
    if (of_a[k]->size() != of_b[k]->size()) return false;
    if (std::memcmp(of_a[k]->data(), of_b[k]->data(), sizeof(float) * of_a[k]->size()) != 0) {
      return false;
    }
  }
  return true;
}

struct Decoded {
  int sound = 0, unread = 0;  // segments
};

// All segments of a file in one go, against the processor's.
void decode_alike(const SceneReader& reader, bool with_harmonics, Decoded& seen) {
  std::vector<CodedSegment> coded;
  std::vector<Result<Gaussians4D>> expected;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    Result<CodedSegment> segment = reader.read(s, with_harmonics);
    Result<Gaussians4D> set = reader.decode(s, with_harmonics);
    if (!segment.ok()) {
      CHECK_FALSE(set.ok());
      ++seen.unread;
      continue;
    }
    coded.push_back(std::move(*segment));
    expected.push_back(std::move(set));
  }
  std::vector<OnDeviceGaussians> sets;
  std::vector<const CodedSegment*> segments;
  std::vector<DeviceGaussians> views;
  for (const CodedSegment& segment : coded) {
    sets.emplace_back(segment.primitives, segment.sh_degree);
    segments.push_back(&segment);
    views.push_back(sets.back().view());
  }
  SegmentDecoder decoder;
  check(decoder.set_tables(reader.tables()));
  check(decoder.prepare(segments, views));
  check(decoder.launch(nullptr));
  const Result<std::vector<bool>> sound = decoder.finish();
  check(sound.status());
  for (std::size_t k = 0; k < coded.size(); ++k) {
    INFO("segment " << k << " of those read, " << coded[k].primitives << " primitives");
    if (expected[k].ok()) {
      CHECK((*sound)[k]);
      CHECK(same_bits(sets[k].read(), *expected[k]));
      ++seen.sound;
    } else {
      INFO(expected[k].status().message());
      // That sum is of planes, which stay on the device.
      const bool sums = expected[k].status().message().find(
                            "decoded planes do not match their checksum") != std::string::npos;
      CHECK((sums || !(*sound)[k]));
    }
  }
}

void pack_alike(const Scene& scene, const WriteSettings& settings, Decoded& seen) {
  const auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  const auto reader = SceneReader::open(memory_source(*bytes));
  check(reader.status());
  decode_alike(**reader, true, seen);
  decode_alike(**reader, false, seen);
}

}  // namespace

TEST_CASE("every conformance vector has the processor's bits, or is refused as by it") {
  const char* const given = std::getenv("STGS_VECTORS");
  const std::filesystem::path folder = given != nullptr ? given : "tests/conformance/vectors";
  REQUIRE(std::filesystem::is_directory(folder));
  int files = 0;
  Decoded seen;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const auto reader = SceneReader::open(entry.path().string());
    if (!reader.ok()) continue;
    INFO(entry.path().filename().string());
    ++files;
    decode_alike(**reader, true, seen);
  }
  std::printf("  %d files that open, %d segments sound, %d refused when read\n", files, seen.sound,
              seen.unread);
  CHECK(files > 60);
  CHECK(seen.sound > 60);
}

TEST_CASE("packed scenes of every degree, coder and size have the processor's bits") {
  Decoded seen;
  for (int degree = 0; degree <= 3; ++degree) {
    const Scene scene = random_scene(20000 + 777 * static_cast<std::size_t>(degree), degree, 60, 7);
    WriteSettings settings;
    pack_alike(scene, settings, seen);
    settings.profile = Profile::kQuantised;
    for (const double quality : {40.0, 85.0, 100.0}) {
      settings.quality = quality;
      pack_alike(scene, settings, seen);
    }
    settings.own_layouts = true;
    pack_alike(scene, settings, seen);
    settings.own_layouts = false;
    settings.coder = SceneCoder::kZstd;
    pack_alike(scene, settings, seen);
  }
  const Scene large = random_scene(300000, 0, 60, 8);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  settings.chunk_seconds = 1000;
  pack_alike(large, settings, seen);
  std::printf("  %d segments of packed scenes\n", seen.sound);
}
