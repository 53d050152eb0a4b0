// SPDX-License-Identifier: Apache-2.0
// The quantised profile: image quality by quality setting and tier, and the reach of its steps.
#include <algorithm>
#include <cmath>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/raster.h"

using namespace stgs;
using stgs::testing::random_scene;

namespace {

math::PinholeCamera camera_of(float width, float height) {
  math::PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.fx = camera.fy = 0.9f * width;
  camera.cx = 0.5f * width;
  camera.cy = 0.5f * height;
  camera.width = width;
  camera.height = height;
  camera.near_plane = 0.1f;
  return camera;
}

// PSNR over three times, of colours clamped to [0, 1].
double psnr(const Gaussians4D& a, const Gaussians4D& b, std::uint32_t frames) {
  SplatFrame splats;
  RasterOutput left, right;
  double squared = 0.0;
  std::size_t samples = 0;
  const auto camera = camera_of(320, 240);
  for (float fraction : {0.1f, 0.5f, 0.83f}) {
    const float t = fraction * static_cast<float>(frames);
    render(a, t, camera, {}, splats, left);
    render(b, t, camera, {}, splats, right);
    for (std::size_t i = 0; i < left.colour.data.size(); ++i) {
      const double d = std::min(1.0f, left.colour.data[i]) - std::min(1.0f, right.colour.data[i]);
      squared += d * d;
      ++samples;
    }
  }
  return -10.0 * std::log10(squared / static_cast<double>(samples));
}

Gaussians4D quantised(const Scene& scene, int quality, std::uint64_t* bytes = nullptr) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.quality = quality;
  auto file = encode_scene(scene, settings);
  INFO(file.status().message());
  REQUIRE(file.ok());
  if (bytes != nullptr) *bytes = file->size();
  auto read = read_scene(memory_source(std::move(*file)));
  INFO(read.status().message());
  REQUIRE(read.ok());
  return std::move(read->gaussians);
}

struct Errors {
  double position = 0, colour = 0;  // RMS
};

// Errors of the first `count` primitives, which are static.
Errors errors_of_first(std::size_t count, const Scene& scene) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.quality = 87;
  std::vector<std::uint32_t> order;
  auto file = encode_scene(scene, settings, &order);
  REQUIRE(file.ok());
  const auto read = read_scene(memory_source(std::move(*file)));
  REQUIRE(read.ok());
  REQUIRE(order.size() == scene.gaussians.size());
  Errors out;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (order[i] >= count) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t k = 3 * order[i] + c;
      out.position +=
          std::pow(read->gaussians.position[3 * i + c] - scene.gaussians.position[k], 2);
      out.colour += std::pow(read->gaussians.sh[3 * i + c] - scene.gaussians.sh[k], 2);
    }
  }
  const auto n = static_cast<double>(count);
  return {std::sqrt(out.position / n), std::sqrt(out.colour / n)};
}

Scene make_static_scene() {
  Scene scene = random_scene(3001, 0, 1, 41);
  Gaussians4D& set = scene.gaussians;
  set.velocity.assign(set.velocity.size(), 0.0f);
  set.time.assign(set.size(), 0.5f);
  set.sigma.assign(set.size(), 1.0f);
  set.radius.assign(set.size(), 1.0f);
  for (float& logit : set.opacity_logit) logit = std::max(logit, -4.0f);
  return scene;
}

}  // namespace

TEST_CASE("renders of a near-lossless file differ by a fraction of a step of 8 bits") {
  for (int sh_degree = 0; sh_degree <= 3; ++sh_degree) {
    const Scene scene = random_scene(4000, sh_degree, 30, 17);
    WriteSettings settings;
    settings.profile = Profile::kNearLossless;
    auto file = encode_scene(scene, settings);
    REQUIRE(file.ok());
    const auto read = read_scene(memory_source(std::move(*file)));
    REQUIRE(read.ok());
    CHECK(psnr(scene.gaussians, read->gaussians, scene.metadata.frames) > 65);
  }
}

TEST_CASE("a huge or distant primitive does not coarsen the steps of the others") {
  const Scene plain = make_static_scene();
  const Errors reference = errors_of_first(3000, plain);
  for (const float size : {2.0f, 4.0f, 7.0f, 60.0f}) {
    Scene scene = plain;
    std::fill_n(&scene.gaussians.log_scale[3 * 3000], 3, size);
    const Errors errors = errors_of_first(3000, scene);
    INFO("log-scale " << size);
    CHECK(errors.position < 1.15 * reference.position);
    CHECK(errors.colour < 1.2 * reference.colour);
  }
  for (const float x : {1e4f, 1e5f, 1e6f, 1e20f}) {
    Scene scene = plain;
    scene.gaussians.position[3 * 3000] = x;
    scene.gaussians.position[3 * 2999] = 3e4f;  // a second distant primitive
    const Errors errors = errors_of_first(2999, scene);
    INFO("at " << x);
    CHECK(errors.position < 1.05 * reference.position);
    CHECK(errors.colour < 1.05 * reference.colour);
  }
}

TEST_CASE("a position out of range is rejected with its coordinates") {
  Scene scene = make_static_scene();
  scene.gaussians.position[3 * 5 + 1] = 1e30f;
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  const auto file = encode_scene(scene, settings);
  CHECK(file.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(file.status().message(), Catch::Contains(", 1e+30, "));
}

TEST_CASE("static primitives have exactly zero velocity after packing") {
  Scene scene = random_scene(500, 0, 60, 14);
  std::fill(scene.gaussians.velocity.begin(), scene.gaussians.velocity.end(), 0.0f);
  for (float v : quantised(scene, 85).velocity) CHECK(v == 0.0f);
}

TEST_CASE("the quantised profile renders close to the lossless one") {
  const Scene scene = random_scene(20000, 3, 60, 11);
  CHECK(psnr(scene.gaussians, quantised(scene, 85), 60) >= 38.0);
  CHECK(psnr(scene.gaussians, quantised(scene, 95), 60) >= 45.0);
}

TEST_CASE("a higher quality takes more bytes and gives a higher PSNR") {
  const Scene scene = random_scene(5000, 2, 60, 12);
  std::uint64_t last_bytes = 0;
  double last_psnr = 15.0;  // the content is recognisable even at quality 0
  for (int quality = 0; quality <= 100; quality += 10) {
    std::uint64_t bytes = 0;
    const double db = psnr(scene.gaussians, quantised(scene, quality, &bytes), 60);
    INFO("quality " << quality << ": " << bytes << " bytes, " << db << " dB");
    CHECK(bytes > last_bytes);
    CHECK(db > last_psnr);
    last_bytes = bytes;
    last_psnr = db;
  }
}

TEST_CASE("the temporal streams of long-lived static primitives take few bytes") {
  Scene scene = random_scene(4000, 0, 60, 15);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = 30.0f + 0.001f * static_cast<float>(i);
    set.sigma[i] = 900.0f + static_cast<float>(i);
    set.radius[i] = 0.3f;
  }
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  const auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  const auto reader = SceneReader::open(memory_source(*bytes));
  REQUIRE(reader.ok());
  std::uint64_t temporal_bytes = 0;
  for (const StreamInfo& stream : (*reader)->streams()) {
    if (stream.name != "time" && stream.name != "sigma" && stream.name != "radius") continue;
    temporal_bytes += stream.bytes;
  }
  CHECK(temporal_bytes < 400);
  CHECK(psnr(set, quantised(scene, 85), 60) >= 38.0);
}

TEST_CASE("each further tier, and then SH, improves the image") {
  Scene scene = random_scene(6000, 2, 60, 16);
  scene.importance.resize(6000);
  for (std::size_t i = 0; i < 6000; ++i) {
    const float opacity = math::opacity_of(scene.gaussians.opacity_logit[i]);
    const float* s = &scene.gaussians.log_scale[3 * i];
    scene.importance[i] = opacity * opacity * std::exp(s[0] + s[1]);
  }
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 3;
  const auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  const auto reader = SceneReader::open(memory_source(*bytes));
  REQUIRE(reader.ok());
  double last = 0.0;
  for (const auto& [tiers, with_sh] : {std::pair{1, false}, {2, false}, {3, false}, {3, true}}) {
    Gaussians4D rendered;
    rendered.sh_degree = 2;
    for (std::uint32_t s = 0; s < (*reader)->segments().size(); ++s) {
      if ((*reader)->segments()[s].tier >= tiers) continue;
      const auto set = (*reader)->decode(s, with_sh);
      REQUIRE(set.ok());
      for (std::size_t i = 0; i < set->size(); ++i) rendered.append(*set, i);
    }
    const double db = psnr(scene.gaussians, rendered, 60);
    INFO(tiers << " tiers, " << (with_sh ? "with" : "without") << " SH: " << db << " dB");
    CHECK(db > last + 0.5);
    last = db;
  }
}
