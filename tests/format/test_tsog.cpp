// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "catch.h"
#include "fixtures/sogst_fixture.h"
#include "fixtures/temporary_folder.h"
#include "fixtures/truncated_archive.h"
#include "stgs/format/timed_formats.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

Result<Scene> read_package(const SogModel& model, const ClipSettings& settings = {},
                           ConversionNotes* notes = nullptr, const ReadLimits& limits = {}) {
  const TemporaryFolder folder;
  model.write_bundle(folder / "a.tsog");
  return read_tsog(folder / "a.tsog", settings, limits, notes);
}

int pixel(const SogModel& model, const char* name, std::size_t i, std::size_t c) {
  return model.images.at(name).rgba[4 * i + c];
}
int code(const SogModel& model, const char* low, const char* high, std::size_t i, std::size_t c) {
  return pixel(model, low, i, c) + 256 * pixel(model, high, i, c);
}

SogModel frames_tsog(int count, int frames, unsigned seed) {
  SogModel model = random_tsog(count, 0, seed);
  std::mt19937 random(seed);
  model.meta["timeline"] = {
      {"type", 0}, {"N", frames}, {"delta", 65536 / frames}, {"files", {"tl.webp", "th.webp"}}};
  add_noise(model, "tl.webp", random);
  add_noise(model, "th.webp", random);
  return model;
}

using Catch::Contains;

}  // namespace

TEST_CASE("tsog: continuous motion and lifespans are decoded as the specification defines") {
  for (const int bytes : {1, 2}) {
    SogModel model = continuous_tsog(24, 1, bytes, 3);
    model.meta["playback"] = {{"duration", 2}, {"fps", 10}};
    ConversionNotes notes;
    const Result<Scene> scene = read_package(model, {}, &notes);
    INFO(scene.status().message());
    REQUIRE(scene.ok());
    CHECK(notes.empty());
    CHECK(scene->metadata.frames == 21);  // the first one at 0 s, the last one at 2 s
    CHECK(scene->metadata.time_base == TimeBase{1, 10});
    const Gaussians4D& set = scene->gaussians;
    REQUIRE(set.size() == 24);
    for (std::size_t i = 0; i < 24; ++i) {
      const double centre = -0.25 + 1.5 * code(model, "tl.webp", "th.webp", i, 0) / 65535;
      const double deviation = 0.125 + 0.375 * code(model, "tl.webp", "th.webp", i, 1) / 65535;
      CHECK(set.time[i] == Approx(20 * centre).margin(1e-5));
      CHECK(set.sigma[i] == Approx(20 * deviation * std::sqrt(2.0)));
      CHECK(set.radius[i] == 0);
      const double mins[] = {-2, 0, -1}, maxs[] = {2, 0.5, 1};
      for (std::size_t c = 0; c < 3; ++c) {
        const double share = bytes == 1 ? pixel(model, "vl.webp", i, c) / 255.0
                                        : code(model, "vl.webp", "vh.webp", i, c) / 65535.0;
        const double velocity = mins[c] + (maxs[c] - mins[c]) * share;
        CHECK(set.velocity[3 * i + c] == Approx(velocity / 20).margin(1e-7));
      }
    }
  }
}

TEST_CASE("tsog: a splat of a frame is visible in that frame only") {
  const SogModel model = frames_tsog(40, 7, 5);
  const Result<Scene> scene = read_package(model);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 7);
  CHECK(scene->metadata.time_base == TimeBase{1, 30});
  std::size_t shown = 0, visible = 0;
  for (int frame = 0; frame < 7; ++frame) {
    const Result<Gaussians4D> set = snapshot_at(*scene, frame);
    REQUIRE(set.ok());
    std::size_t expected = 0;
    for (std::size_t i = 0; i < 40; ++i) {
      const int at = std::min(6, code(model, "tl.webp", "th.webp", i, 0) / (65536 / 7));
      expected += at == frame && pixel(model, "sh0.webp", i, 3) > 0 ? 1 : 0;
      visible += frame == 0 && pixel(model, "sh0.webp", i, 3) > 0 ? 1 : 0;
    }
    CHECK(set->size() == expected);
    shown += set->size();
  }
  CHECK(shown == visible);
}

TEST_CASE("tsog: a model without a timeline is static") {
  SogModel model = random_tsog(10, 2, 4);
  ConversionNotes notes;
  model.meta["playback"] = {{"duration", 5}, {"rate", 2}};
  model.meta["audio"] = {{"file", "audio/track.mp3"}};
  const Result<Scene> scene = read_package(model, {}, &notes);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 1);
  CHECK(scene->gaussians.sh_degree == 2);
  REQUIRE(notes.size() == 2);
  CHECK_THAT(notes[0], Contains("audio track is not converted"));
  CHECK_THAT(notes[1], Contains("rate 2"));
  CHECK(read_package(model, {5u, {}}).status().code() == StatusCode::kUsage);
}

TEST_CASE("tsog: the file's timing applies before the caller's") {
  SogModel model = continuous_tsog(4, 0, 2, 3);
  Result<Scene> scene = read_package(model);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 300);
  CHECK(scene->metadata.time_base == TimeBase{1, 30});
  scene = read_package(model, {120u, TimeBase{1, 24}});
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 120);
  CHECK(scene->metadata.time_base == TimeBase{1, 24});
  model.meta["fps"] = 12;
  scene = read_package(model, {120u, {}});
  REQUIRE(scene.ok());
  CHECK(scene->metadata.time_base == TimeBase{1, 12});
  CHECK_THAT(read_package(model, {{}, TimeBase{1, 24}}).status().message(),
             Contains("states its frame rate (12 fps)"));
  model.meta["playback"]["duration"] = 4;
  scene = read_package(model);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 49);
  CHECK_THAT(read_package(model, {120u, {}}).status().message(),
             Contains("states its number of frames (49)"));
  model = frames_tsog(8, 8, 1);
  model.meta["playback"]["duration"] = 2;
  scene = read_package(model);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 8);
  CHECK(scene->metadata.time_base == TimeBase{1, 4});
}

TEST_CASE("tsog: codebooks may be short, and indices beyond them are rejected") {
  SogModel model = random_tsog(8, 1, 2);
  model.meta["scales"]["codebook"] = {-3.0, -2.0};
  model.meta["sh0"]["codebook"] = {0.25};
  model.meta["shN"]["codebook"] = {0.0, 0.5, -0.5};
  const auto all = [&](const char* name, int modulus) {
    std::vector<std::uint8_t>& rgba = model.images[name].rgba;
    for (std::size_t i = 0; i < rgba.size(); ++i) {
      if (i % 4 < 3) rgba[i] = static_cast<std::uint8_t>(rgba[i] % modulus);
    }
  };
  all("scales.webp", 2);
  all("sh0.webp", 1);
  all("centroids.webp", 3);
  const Result<Scene> scene = read_package(model);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  for (std::size_t i = 0; i < 24; ++i) {
    CHECK(scene->gaussians.log_scale[i] ==
          (pixel(model, "scales.webp", i / 3, i % 3) == 1 ? -2.0f : -3.0f));
  }
  CHECK(scene->gaussians.sh[0] == 0.25f);
  for (const char* name : {"scales.webp", "sh0.webp", "centroids.webp"}) {
    SogModel invalid = model;
    for (std::uint8_t& byte : invalid.images[name].rgba) byte = 200;
    INFO(name);
    CHECK_THAT(read_package(invalid).status().message(), Contains("invalid index"));
  }
}

TEST_CASE("tsog: inconsistent metadata is rejected") {
  const SogModel valid = continuous_tsog(20, 0, 2, 6);
  const auto rejects = [&](const char* pointer, const nlohmann::json& value, const char* message) {
    SogModel invalid = valid;
    invalid.meta[nlohmann::json::json_pointer(pointer)] = value;
    INFO(pointer << " " << value);
    const Status status = read_package(invalid).status();
    CHECK_THAT(status.message(), Contains(message));
    CHECK((status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported));
  };
  rejects("/version", 2, "unsupported .tsog version (expected 4, got 2)");
  rejects("/profile/id", "unknown", "unsupported .tsog profile");
  rejects("/profile/version", 2, "unsupported .tsog profile");
  rejects("/profile", nullptr, "unsupported .tsog profile null");
  rejects("/count", 1.5, "count");
  rejects("/count", 9007199254740992, "too many splats");
  rejects("/sh0/codebook", {nullptr}, "sh0.codebook[0]");
  rejects("/scales/codebook", {1e39}, "scales.codebook[0]");
  rejects("/scales/codebook", codebook_of(0, 1, 257), "1 to 256 numbers");
  rejects("/scales/codebook", "x", "1 to 256 numbers");
  rejects("/means/mins", {0, 0}, "means.mins");
  rejects("/quats/files", {"images/../../a.webp"}, "outside the archive");
  rejects("/timeline/type", 2, "timeline.type");
  rejects("/timeline/mins/1", 0, "not positive");
  rejects("/timeline/mins/1", 1e-100, "not positive");
  rejects("/timeline/maxs/1", 0.01, "not positive");
  rejects("/timeline", {{"type", 0}, {"N", 3}, {"delta", 1}, {"files", {"a", "b"}}}, "delta");
  rejects("/timeline", {{"type", 0}, {"N", 70000}, {"delta", 0}, {"files", {"a", "b"}}}, "N");
  rejects("/timeline", nullptr, "temporal: without a timeline");
  rejects("/temporal/scales", nlohmann::json::object(), "only motion is supported");
  rejects("/temporal/means/mins", {{0, 0, 0}, {0, 0, 0}}, "of equal length");
  rejects("/temporal/means/mins", {{"0", {0, 0, 0}}}, "of equal length");
  rejects("/temporal/means/mins/0", {0, 0}, "mins");
  rejects("/playback/rate", 4.1, "playback.rate");
  rejects("/playback", {{"duration", 1e9}, {"fps", 1e6}}, "too many frames");
  rejects("/playback/duration", -1, "playback.duration");
  SogModel quadratic = valid;
  quadratic.meta["temporal"]["means"]["mins"] = {{0, 0, 0}, {0, 0, 0}};
  quadratic.meta["temporal"]["means"]["maxs"] = {{1, 1, 1}, {1, 1, 1}};
  CHECK_THAT(read_package(quadratic).status().message(), Contains("motion of order 2"));
  ReadLimits limits;
  limits.max_primitives = 19;
  CHECK(read_package(valid, {}, nullptr, limits).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("tsog: a truncated archive is rejected at every byte") {
  check_truncations(continuous_tsog(3, 0, 1, 9), "a.tsog",
                    [](const std::string& path) { return read_tsog(path).status(); });
}
