// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/temporary_folder.h"

using namespace stgs;
using stgs::testing::fingerprints;
using stgs::testing::random_scene;

namespace {

Result<std::unique_ptr<SceneReader>> open_bytes(std::vector<std::uint8_t> bytes) {
  return SceneReader::open(memory_source(std::move(bytes)));
}

}  // namespace

TEST_CASE("the lossless profile preserves every bit of every primitive") {
  for (int degree = 0; degree <= 3; ++degree) {
    Scene scene = random_scene(700, degree, 60, 7);
    scene.gaussians.position[0] = -0.0f;
    scene.gaussians.sh[1] = 1e-42f;  // subnormal
    const testing::TemporaryFolder folder;
    const std::string path = folder / "scene.stgs";
    const Status written = write_scene(path, scene, {});
    INFO(written.message());
    REQUIRE(written.ok());
    const Result<Scene> read = read_scene(path);
    INFO(read.status().message());
    REQUIRE(read.ok());
    auto before = fingerprints(scene.gaussians), after = fingerprints(read->gaussians);
    std::sort(before.begin(), before.end());
    std::sort(after.begin(), after.end());
    CHECK(before == after);
  }
}

TEST_CASE("metadata round-trips") {
  Scene scene = random_scene(100, 1, 90, 3);
  scene.metadata.time_base = {1001, 30000};
  scene.metadata.metres_per_unit = 0.25f;
  scene.metadata.up[1] = -1;
  scene.metadata.floor[1] = 1.5f;
  scene.metadata.audio = "music.opus";
  scene.metadata.audio_begin = -2.5;
  scene.metadata.primaries = 9;
  scene.metadata.transfer = 200;
  scene.metadata.background[1] = 0.5f;
  scene.metadata.title = "Tanz, Saal 3 \xE2\x80\x94 Probe";
  StartCamera camera;
  camera.fx = camera.fy = 500.0f;
  camera.width = 640;
  camera.height = 360;
  camera.translation[2] = 1.5f;
  scene.metadata.start_camera = camera;
  Result<std::vector<std::uint8_t>> bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  const auto reader = open_bytes(*bytes);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  const SceneMetadata& metadata = (*reader)->metadata();
  CHECK(metadata.time_base == TimeBase{1001, 30000});
  CHECK(metadata.frames == 90);
  CHECK(metadata.metres_per_unit == 0.25f);
  CHECK(metadata.up[1] == -1.0f);
  CHECK(metadata.floor[1] == 1.5f);
  CHECK(metadata.audio == "music.opus");
  CHECK(metadata.audio_begin == -2.5);
  CHECK(metadata.primaries == 9);
  CHECK(metadata.transfer == 200);
  CHECK(metadata.background[1] == 0.5f);
  CHECK(metadata.near_plane == 0.1f);
  CHECK(metadata.title == scene.metadata.title);
  CHECK(metadata.generator == "test");
  REQUIRE(metadata.start_camera.has_value());
  CHECK(metadata.start_camera->translation[2] == 1.5f);
  CHECK(metadata.start_camera->width == 640);
  CHECK((*reader)->profile() == Profile::kLossless);
  CHECK((*reader)->version_major() == kFormatMajor);
  CHECK((*reader)->version_minor() == kFormatMinor);
  CHECK((*reader)->sh_degree() == 1);
  CHECK((*reader)->primitives() == 100);
  CHECK((*reader)->file_bytes() == bytes->size());
  std::uint64_t stream_bytes = 0;
  for (const StreamInfo& stream : (*reader)->streams()) stream_bytes += stream.bytes;
  CHECK(stream_bytes > 0);
  CHECK(stream_bytes < bytes->size());
  for (std::size_t i = 0; i < 300; i += 3) {
    CHECK(scene.gaussians.position[i] >= metadata.bounds_min[0]);
    CHECK(scene.gaussians.position[i] <= metadata.bounds_max[0]);
  }
}

TEST_CASE("an empty scene is a valid file") {
  Scene scene = random_scene(0, 3, 1, 1);
  const auto bytes = encode_scene(scene, {});
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  const auto reader = open_bytes(*bytes);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK((*reader)->primitives() == 0);
  CHECK((*reader)->segments_between(0, 1).empty());
}

TEST_CASE("writing the same scene twice gives the same bytes") {
  const Scene scene = random_scene(500, 2, 40, 5);
  for (Profile profile : {Profile::kLossless, Profile::kQuantised, Profile::kDraco}) {
    if (!check_profile(profile).ok()) continue;
    WriteSettings settings;
    settings.profile = profile;
    const auto once = encode_scene(scene, settings), twice = encode_scene(scene, settings);
    REQUIRE(once.ok());
    CHECK(*once == *twice);
  }
}

TEST_CASE("coded and raw planes decode to the same scene, and the coded ones are smaller") {
  Scene scene = random_scene(3000, 3, 60, 5);
  for (std::size_t i = 0; i < 300; ++i) scene.gaussians.sh[i * 48 + 5] *= 1000.0f;  // many digits
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  std::vector<std::size_t> sizes;
  std::vector<Gaussians4D> sets;
  for (const SceneCoder coder : {SceneCoder::kRans, SceneCoder::kBytes}) {
    settings.coder = coder;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    const auto read = read_scene(memory_source(*bytes));
    INFO(read.status().message());
    REQUIRE(read.ok());
    sizes.push_back(bytes->size());
    sets.push_back(read->gaussians);
  }
  CHECK(sizes[0] < sizes[1]);
  CHECK(fingerprints(sets[0]) == fingerprints(sets[1]));
}

TEST_CASE("invalid scenes and settings are rejected, naming the value") {
  const Scene valid = random_scene(20, 1, 30, 2);
  const auto message = [](const Scene& scene, const WriteSettings& settings = {}) {
    const auto bytes = encode_scene(scene, settings);
    CHECK(bytes.status().code() == StatusCode::kUsage);
    return bytes.status().message();
  };
  Scene invalid = valid;
  invalid.gaussians.velocity[3 * 11 + 2] = NAN;
  CHECK(message(invalid) ==
        "invalid velocity[2] of primitive 11 (expected a finite number, got nan)");
  invalid = valid;
  invalid.gaussians.sh[12 * 4 + 3] = INFINITY;
  CHECK(message(invalid) == "invalid sh1[0] of primitive 4 (expected a finite number, got inf)");
  invalid = valid;
  invalid.gaussians.sigma[7] = 0.0f;
  CHECK(message(invalid) == "invalid sigma of primitive 7 (expected > 0, got 0)");
  invalid = valid;
  invalid.gaussians.radius[0] = -1.0f;
  CHECK(message(invalid) == "invalid radius of primitive 0 (expected >= 0, got -1)");
  invalid = valid;
  std::fill_n(invalid.gaussians.rotation.begin() + 4 * 19, 4, 0.0f);
  CHECK(message(invalid) == "invalid rotation of primitive 19 (quaternion of length 0)");
  invalid = valid;
  invalid.gaussians.time.pop_back();
  CHECK(message(invalid) == "array lengths do not match (for 20 primitives)");
  invalid = valid;
  invalid.metadata.near_plane = -1.0f;
  CHECK(message(invalid) ==
        "metadata: background, bounds or near plane is not finite, or the near plane is negative");
  invalid = valid;
  invalid.metadata.background[2] = NAN;
  CHECK(message(invalid) ==
        "metadata: background, bounds or near plane is not finite, or the near plane is negative");
  invalid = valid;
  // Latin-1, an overlong slash, a surrogate, past the last code point, truncated.
  for (const char* text : {"caf\xE9", "\xC0\xAF", "\xED\xA0\x80", "\xF4\x90\x80\x80", "\xE2\x82"}) {
    invalid.metadata.title = text;
    CHECK(message(invalid) == "metadata: generator, title or audio location is not UTF-8");
  }
  invalid = valid;
  invalid.metadata.title = "caf\xC3\xA9 \xE2\x82\xAC \xF0\x9F\x8E\xA5";
  CHECK(encode_scene(invalid, {}).ok());
  StartCamera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 500.0f;
  invalid.metadata = valid.metadata;
  invalid.metadata.start_camera = camera;
  CHECK(encode_scene(invalid, {}).ok());
  invalid.metadata.start_camera->height = 0;
  CHECK(message(invalid) ==
        "metadata: start camera has an invalid size (expected sides of 1 to 32768 pixels, got "
        "640x0)");
  invalid.metadata.start_camera = camera;
  invalid.metadata.start_camera->fy = 0.0f;
  CHECK(message(invalid).find(
            "start camera has values that are not finite, or a focal length <= 0") !=
        std::string::npos);
  invalid.metadata.start_camera = camera;
  invalid.metadata.start_camera->rotation[4] = 1.1f;
  CHECK(message(invalid) == "metadata: start camera has an invalid rotation matrix");
  invalid = valid;
  invalid.metadata.frames = 0;
  CHECK(message(invalid).find("at least one frame") != std::string::npos);
  WriteSettings settings;
  settings.quality = 101;
  CHECK(message(valid, settings) == "invalid quality (expected 0 to 100, got 101)");
  settings = {};
  settings.chunk_seconds = -1.0;
  CHECK(message(valid, settings).find("invalid chunk length") != std::string::npos);
}

TEST_CASE("limits reject a file before it is decoded") {
  const Scene scene = random_scene(300, 0, 30, 4);
  const auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  ReadLimits limits;
  limits.max_primitives = 299;
  auto reader = SceneReader::open(memory_source(*bytes), limits);
  CHECK(reader.status().code() == StatusCode::kUnsupported);
  CHECK(reader.status().message().find("300 primitives exceed the limit of 299") !=
        std::string::npos);
  limits = {};
  limits.max_memory = 4000;
  reader = SceneReader::open(memory_source(*bytes), limits);
  CHECK(reader.status().code() == StatusCode::kUnsupported);
}

TEST_CASE("an unwritable output is an error and leaves nothing behind") {
  const Scene scene = random_scene(10, 0, 30, 4);
  const testing::TemporaryFolder outer;
  const std::string folder = outer / "folder";
  std::filesystem::create_directory(folder);
  CHECK(write_scene(folder, scene, {}).code() == StatusCode::kIo);
  CHECK(write_scene(folder + "/none/x.stgs", scene, {}).code() == StatusCode::kIo);
  CHECK(std::filesystem::is_empty(folder));
  CHECK(write_scene("/dev/null", scene, {}).ok());
  CHECK(std::filesystem::is_character_file("/dev/null"));
  const Status full = write_scene("/dev/full", scene, {});
  CHECK(full.code() == StatusCode::kIo);
  CHECK(full.message() == "/dev/full: cannot write: No space left on device");
  CHECK(std::filesystem::is_character_file("/dev/full"));
}
