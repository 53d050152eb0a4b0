// SPDX-License-Identifier: Apache-2.0
// The reader of format version 1.x against the conformance vectors of that version, and against
// recover_scene(), as long as that reads version 1.x.
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/damage_report.h"
#include "stgs1_digest.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

const std::string kRoot = std::string(STGS_TEST_DATA) + "/../..";
const std::string kConformance = kRoot + "/tests/conformance";

// Checks that both readers read the same scene, or both refuse the file.
void compare(const Stgs1Bytes& bytes, const ReadLimits& limits = {}) {
  ConversionNotes notes;
  const auto scene = read_stgs1(*memory_source(bytes, "x.stgs"), limits, &notes);
  DamageReport report;
  const auto expected = recover_scene(memory_source(bytes, "x.stgs"), report, limits);
  INFO(scene.status().message() << " / " << expected.status().message());
  REQUIRE(scene.ok() == expected.ok());
  if (!scene.ok()) {
    CHECK(scene.status().code() == expected.status().code());
    return;
  }
  CHECK(scene_digest(*scene) == scene_digest(*expected));
  CHECK(scene->metadata.start_camera.has_value() == expected->metadata.start_camera.has_value());
  CHECK(scene->metadata.window == expected->metadata.window);
  CHECK(scene->parts == expected->parts);
  CHECK(scene->quantisation == expected->quantisation);
  if (report.any()) CHECK(!notes.empty());
}

}  // namespace

TEST_CASE("the vectors of version 1.1 decode as their manifest states") {
  std::ifstream file(kConformance + "/manifest.json");
  const auto vectors = nlohmann::json::parse(file).at("vectors");
  REQUIRE(vectors.size() > 250);
  for (const auto& vector : vectors) {
    const std::string name = vector.at("name");
    INFO(name);
    ReadLimits limits;
    if (vector.contains("limits")) {
      const auto& stated = vector.at("limits");
      limits.max_memory = stated.value("max_memory", limits.max_memory);
      limits.max_primitives = stated.value("max_primitives", limits.max_primitives);
    }
    const Stgs1Bytes bytes = stgs1_file(kConformance + "/vectors/" + name + ".stgs");
    const Stgs1Description found = describe_stgs1(bytes, limits);
    CHECK(found.decoded == vector.at("decoded").get<std::string>());
    CHECK(found.refused == vector.value("refused", std::vector<std::string>()));
    CHECK(found.is_sh_zero);
    compare(bytes, limits);
  }
}

TEST_CASE("files of all profiles are read as recover_scene() reads them") {
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised, Profile::kDraco}) {
    if (!check_profile(profile).ok()) continue;
    for (const int degree : {0, 1, 3}) {
      for (const SceneCoder coder : {SceneCoder::kRans, SceneCoder::kZstd}) {
        Scene scene = random_scene(3000, degree, 60, 3u + static_cast<unsigned>(degree));
        scene.importance = importance_by_size(scene.gaussians, 60);
        scene.quantisation = choose_quantisation(scene.gaussians, scene.importance, 60, 80);
        scene.metadata.start_camera.emplace();
        scene.metadata.start_camera->fx = scene.metadata.start_camera->fy = 100;
        scene.metadata.start_camera->width = scene.metadata.start_camera->height = 64;
        WriteSettings settings;
        settings.profile = profile;
        settings.chunk_seconds = 0.3;
        settings.coder = coder;
        settings.own_layouts = degree == 1;
        const auto bytes = encode_scene(scene, settings);
        REQUIRE(bytes.ok());
        INFO(profile_name(profile) << " of degree " << degree);
        compare(*bytes);
        const auto read = read_stgs1(*memory_source(*bytes));
        REQUIRE(read.ok());
        CHECK(read->gaussians.size() > 2000);
        CHECK(read->quantisation.has_value() == (profile == Profile::kLossless));
      }
    }
  }
  for (const char* name : {"draco.stgs", "quantised.stgs"}) {
    compare(stgs1_file(std::string(STGS_TEST_DATA) + "/draco/" + name));
  }
}

TEST_CASE("each flipped byte has the same effect on both readers") {
  Scene scene = random_scene(24, 1, 30, 21);
  scene.importance.assign(24, 1.0f);
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    settings.tiers = 2;
    settings.chunk_seconds = 0.2;
    const auto intact = encode_scene(scene, settings);
    REQUIRE(intact.ok());
    for (std::size_t at = 0; at < intact->size(); ++at) {
      Stgs1Bytes bytes = *intact;
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << at % 8);
      INFO("byte " << at);
      compare(bytes);
    }
    for (std::size_t size = 0; size < intact->size(); size += 7) {
      INFO(size << " bytes");
      compare({intact->begin(), intact->begin() + static_cast<std::ptrdiff_t>(size)});
    }
  }
}

TEST_CASE("a truncated recording is read as recover_scene() reads it") {
  for (const char* name : {"growing_closed", "fragment_damaged", "growing_copied"}) {
    const Stgs1Bytes all = stgs1_file(kConformance + "/vectors/" + name + ".stgs");
    for (std::size_t size = 0; size < all.size(); ++size) {
      INFO(name << ": " << size << " bytes");
      compare({all.begin(), all.begin() + static_cast<std::ptrdiff_t>(size)});
    }
  }
}

// Writes expected.txt for the files of a folder: STGS1_RECORD=FOLDER test_stgs1 [record]
TEST_CASE("record the expected digests", "[.][record]") {
  const char* const folder = std::getenv("STGS1_RECORD");
  REQUIRE(folder != nullptr);
  Scene scene = random_scene(160, 2, 60, 5);
  SceneMetadata& metadata = scene.metadata;
  metadata.start_camera.emplace();
  metadata.start_camera->fx = metadata.start_camera->fy = 500;
  metadata.start_camera->translation[2] = 2;
  metadata.start_camera->width = 640;
  metadata.start_camera->height = 480;
  metadata.window = CaptureWindow{10, 100, 3, 4};
  metadata.metres_per_unit = 0.5f;
  metadata.up[1] = -1;
  metadata.floor[1] = 1.5f;
  metadata.background[0] = 0.25f;
  metadata.audio = "sound.opus";
  metadata.audio_begin = -2.5;
  for (const Profile profile : {Profile::kQuantised, Profile::kLossless}) {
    if (profile == Profile::kLossless) scene = random_scene(24, 0, 60, 5);
    scene.importance = importance_by_size(scene.gaussians, 60);
    scene.quantisation = choose_quantisation(scene.gaussians, scene.importance, 60, 80);
    WriteSettings settings;
    settings.profile = profile;
    settings.tiers = 2;
    settings.chunk_seconds = 0.5;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    const bool is_packed = profile == Profile::kQuantised;
    std::ofstream(std::string(folder) + (is_packed ? "/packed.stgs" : "/steps.stgs"),
                  std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes->data()),
               static_cast<std::streamsize>(bytes->size()));
  }
  std::ifstream names(std::string(folder) + "/names.txt");
  std::ofstream out(std::string(folder) + "/expected.txt");
  std::ifstream file(kConformance + "/manifest.json");
  const auto vectors = nlohmann::json::parse(file).at("vectors");
  for (std::string name; names >> name;) {
    const Stgs1Bytes bytes = stgs1_file(std::string(folder) + "/" + name + ".stgs");
    DamageReport report;
    const auto read = recover_scene(memory_source(bytes), report);
    Stgs1Description found = describe_stgs1(bytes, {});
    for (const auto& vector : vectors) {
      if (vector.at("name") == name) REQUIRE(vector.at("decoded") == found.decoded);
    }
    std::string refused;
    for (const std::string& part : found.refused) refused += (refused.empty() ? "" : ", ") + part;
    out << name << ' ' << found.decoded << ' ' << (read.ok() ? scene_digest(*read) : "refused")
        << (refused.empty() ? "" : " ") << refused << '\n';
  }
}
