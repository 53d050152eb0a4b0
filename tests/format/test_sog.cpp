// SPDX-License-Identifier: Apache-2.0
#include <sys/resource.h>

#include <cmath>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/sog_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/interchange.h"

using namespace stgs;
using stgs::testing::encode_webp;
using stgs::testing::fingerprints;
using stgs::testing::random_sog;
using stgs::testing::RgbaImage;
using stgs::testing::SogModel;
using stgs::testing::TemporaryFolder;

namespace {

// The status of reading a model that must be rejected.
Status read_error(const SogModel& model, const ReadLimits& limits = {}) {
  const TemporaryFolder folder;
  model.write_folder(folder.path);
  const Result<Scene> scene = read_sog(folder.path, limits);
  CHECK_FALSE(scene.ok());
  return scene.status();
}

using Catch::Contains;

}  // namespace

TEST_CASE("SOG: every value is decoded as the specification defines") {
  const TemporaryFolder folder;
  const SogModel model = random_sog(21, 2, 3);
  model.write_folder(folder.path);
  ConversionNotes notes;
  const Result<Scene> scene = read_sog(folder / "meta.json", {}, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(notes.empty());
  CHECK(scene->metadata.frames == 1);
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 21);
  REQUIRE(set.sh_degree == 2);
  const auto byte = [&](const char* name, std::size_t i, std::size_t c) {
    return int{model.images.at(name).rgba[4 * i + c]};
  };
  const double mins[] = {-2.5, -1.0, 0.0}, maxs[] = {1.5, 1.0, 3.0};
  for (std::size_t i = 0; i < 21; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double q = (byte("l.webp", i, c) + 256 * byte("u.webp", i, c)) / 65535.0;
      const double mapped = mins[c] + (maxs[c] - mins[c]) * q;
      const double x = mapped < 0 ? 1 - std::exp(-mapped) : std::exp(mapped) - 1;
      CHECK(set.position[3 * i + c] == Approx(x).margin(1e-6));
      CHECK(set.log_scale[3 * i + c] == Approx(-9 + 9.5 * byte("scales.webp", i, c) / 255));
      CHECK(set.sh[27 * i + c] == Approx(-2 + 4.0 * byte("sh0.webp", i, c) / 255).margin(1e-6));
      const std::size_t entry = static_cast<std::size_t>(byte("labels.webp", i, 0));
      for (std::size_t k = 0; k < 8; ++k) {
        const std::size_t pixel = entry / 64 * 512 + entry % 64 * 8 + k;
        CHECK(set.sh[27 * i + 3 * (k + 1) + c] ==
              Approx(-0.5 + byte("centroids.webp", pixel, c) / 255.0).margin(1e-6));
      }
    }
    const int alpha = byte("sh0.webp", i, 3);
    if (alpha > 0 && alpha < 255) {
      CHECK(1 / (1 + std::exp(-set.opacity_logit[i])) == Approx(alpha / 255.0));
    }
    const std::size_t largest = static_cast<std::size_t>(byte("quats.webp", i, 3) - 252);
    double square = 0;
    for (std::size_t c = 0, from = 0; c < 4; ++c) {
      const float q = set.rotation[4 * i + c];
      square += double{q} * q;
      if (c == largest) {
        CHECK(q >= 0);
      } else {
        const double stored = (byte("quats.webp", i, from++) / 127.5 - 1) / std::sqrt(2.0);
        CHECK(q == Approx(stored).margin(1e-6));
      }
    }
    CHECK(square >= 1 - 1e-5);
  }
}

TEST_CASE("SOG: a bundle and a folder decode to the same model") {
  const TemporaryFolder folder;
  const SogModel model = random_sog(33, 3, 5);
  model.write_folder(folder / "model");
  model.write_bundle(folder / "model.sog");
  const Result<Scene> from_folder = read_sog(folder / "model");
  const Result<Scene> from_bundle = read_sog(folder / "model.sog");
  INFO(from_folder.status().message() << from_bundle.status().message());
  REQUIRE(from_folder.ok());
  REQUIRE(from_bundle.ok());
  CHECK(fingerprints(from_folder->gaussians) == fingerprints(from_bundle->gaussians));
}

TEST_CASE("SOG: the chunks of a folder are joined in the order of their names") {
  const TemporaryFolder folder;
  random_sog(9, 0, 1).write_folder(folder / "2_0");
  random_sog(12, 1, 2).write_folder(folder / "2_1");
  random_sog(5, 0, 3).write_bundle(folder / "2_2.sog");
  const Result<Scene> all = read_sog(folder.path), second = read_sog(folder / "2_1");
  INFO(all.status().message());
  REQUIRE(all.ok());
  REQUIRE(second.ok());
  CHECK(all->gaussians.size() == 26);
  CHECK(all->gaussians.sh_degree == 1);  // the highest degree; others are padded with zeros
  const auto complete = fingerprints(all->gaussians), part = fingerprints(second->gaussians);
  CHECK(std::vector<std::string>(complete.begin() + 9, complete.begin() + 21) == part);
  CHECK(all->gaussians.sh[3] == 0.0f);
  std::ofstream(folder / "lod-meta.json") << "{}";
  CHECK(read_sog(folder.path).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("SOG: a folder may have more chunks than the process may open files") {
  const TemporaryFolder folder;
  constexpr int kChunks = 40;
  for (int i = 0; i < kChunks; ++i)
    random_sog(1, 0, 1).write_bundle(folder / (std::to_string(i) + ".sog"));
  rlimit before{};
  REQUIRE(getrlimit(RLIMIT_NOFILE, &before) == 0);
  const rlimit few{30, before.rlim_max};
  REQUIRE(setrlimit(RLIMIT_NOFILE, &few) == 0);
  const Result<Scene> all = read_sog(folder.path);
  REQUIRE(setrlimit(RLIMIT_NOFILE, &before) == 0);
  INFO(all.status().message());
  REQUIRE(all.ok());
  CHECK(all->gaussians.size() == kChunks);
}

TEST_CASE("SOG: a null first entry of a codebook, as early writers left it, is extrapolated") {
  const TemporaryFolder folder;
  SogModel model = random_sog(8, 0, 4);
  model.meta["scales"]["codebook"][0] = nullptr;
  model.images["scales.webp"].rgba[0] = 0;
  model.write_folder(folder.path);
  const Result<Scene> scene = read_sog(folder.path);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.log_scale[0] == Approx(-9).margin(0.05));
}

TEST_CASE("SOG: inconsistent metadata is rejected") {
  const SogModel valid = random_sog(20, 1, 6);
  SogModel invalid = valid;
  invalid.meta["count"] = 1000;
  CHECK_THAT(read_error(invalid).message(), Contains("image too small"));
  invalid = valid;
  invalid.meta["count"] = 4'000'000'000'000;
  CHECK(read_error(invalid).code() == StatusCode::kUnsupported);
  invalid = valid;
  invalid.meta["count"] = -1;
  CHECK(read_error(invalid).code() == StatusCode::kInvalidFile);
  invalid = valid;
  invalid.meta["means"]["mins"] = {0, 0};
  CHECK_THAT(read_error(invalid).message(), Contains("means.mins"));
  invalid = valid;
  invalid.meta["means"]["maxs"][1] = 1e30;
  CHECK_THAT(read_error(invalid).message(), Contains("exceed the range of binary32"));
  invalid = valid;
  invalid.meta["scales"]["codebook"].erase(7);
  CHECK_THAT(read_error(invalid).message(), Contains("scales.codebook"));
  invalid = valid;
  invalid.meta["quats"]["files"] = {"../quats.webp"};
  CHECK_THAT(read_error(invalid).message(), Contains("outside the"));
  invalid = valid;
  invalid.meta["sh0"]["files"] = {"absent.webp"};
  CHECK(read_error(invalid).code() == StatusCode::kIo);
  invalid = valid;
  invalid.meta["shN"]["bands"] = 4;
  CHECK_THAT(read_error(invalid).message(), Contains("bands"));
  invalid = valid;
  invalid.meta["shN"]["count"] = 129;  // the image holds two rows of 64
  CHECK_THAT(read_error(invalid).message(), Contains("129 entries"));
  invalid = valid;
  invalid.images["labels.webp"].rgba[1] = 1;  // label 256 and more
  CHECK_THAT(read_error(invalid).message(), Contains("invalid label"));
  invalid = valid;
  invalid.images["quats.webp"].rgba[3] = 200;
  CHECK_THAT(read_error(invalid).message(), Contains("alpha of splat 0"));
  invalid = valid;
  invalid.images["sh0.webp"] = random_sog(20, 0, 1, 10).images["sh0.webp"];
  CHECK_THAT(read_error(invalid).message(), Contains("image size differs within the model"));
  invalid = valid;
  invalid.files["meta.json"] = "{\"version\": 2, \"count\": ";
  CHECK_THAT(read_error(invalid).message(), Contains("not valid JSON"));
  invalid.files["meta.json"] = "[1, 2]";
  CHECK(read_error(invalid).code() == StatusCode::kInvalidFile);
  invalid.files["meta.json"] = "{\"means\": {}}";
  CHECK_THAT(read_error(invalid).message(), Contains("unsupported SOG version"));
  invalid.files["meta.json"] = "{\"version\": 3}";
  CHECK(read_error(invalid).code() == StatusCode::kUnsupported);
}

TEST_CASE("SOG: damaged images are rejected") {
  SogModel invalid = random_sog(20, 0, 7);
  const std::string image = encode_webp(invalid.images["scales.webp"]);
  for (const std::size_t length : {std::size_t{0}, std::size_t{9}, image.size() / 2}) {
    invalid.files["scales.webp"] = image.substr(0, length);
    CHECK(read_error(invalid).code() == StatusCode::kInvalidFile);
  }
  invalid.files["scales.webp"] = encode_webp(invalid.images["scales.webp"], false);
  CHECK_THAT(read_error(invalid).message(), Contains("lossy"));
  invalid.files["scales.webp"] = "\x89PNG\r\n\x1a\n____________________";
  CHECK_THAT(read_error(invalid).message(), Contains("not a WebP image"));
}

TEST_CASE("SOG: the caller's limits apply before memory is allocated") {
  const SogModel model = random_sog(500, 0, 8, 25);
  ReadLimits limits;
  limits.max_primitives = 499;
  CHECK(read_error(model, limits).code() == StatusCode::kUnsupported);
  limits = {};
  limits.max_memory = 25 * 20 * 4 - 1;  // a byte less than one image
  CHECK(read_error(model, limits).code() == StatusCode::kUnsupported);
}

TEST_CASE("SOG: damaged bundles are rejected") {
  const TemporaryFolder folder;
  const std::string path = folder / "model.sog";
  random_sog(300, 0, 9, 20).write_bundle(path);
  std::ifstream file(path, std::ios::binary);
  const std::string complete{std::istreambuf_iterator<char>(file), {}};
  const auto read_bytes = [&](const std::string& bytes) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    return read_sog(path).status().code();
  };
  CHECK(read_bytes(complete) == StatusCode::kOk);
  for (const std::size_t length : {std::size_t{0}, std::size_t{30}, complete.size() - 5}) {
    CHECK(read_bytes(complete.substr(0, length)) == StatusCode::kInvalidFile);
  }
  // The checksum detects a flipped bit in a member's data.
  std::string damaged = complete;
  damaged[damaged.find("WEBP") + 40] ^= 4;
  CHECK(read_bytes(damaged) == StatusCode::kInvalidFile);
  CHECK(read_sog(folder / "absent.sog").status().code() == StatusCode::kIo);
}
