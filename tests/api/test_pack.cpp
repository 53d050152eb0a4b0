// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/pack.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

#include "catch.h"
#include "copy_fixture.h"
#include "scene_fixture.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/raster.h"
#include "temporary_folder.h"

using namespace stgs;
using stgs::testing::random_scene;
using stgs::testing::TemporaryFolder;

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

// Mean over a few moments, of colours clamped to [0, 1].
double psnr(const Gaussians4D& a, const Gaussians4D& b, std::uint32_t frames) {
  SplatFrame splats;
  RasterOutput left, right;
  double squared = 0.0;
  std::size_t samples = 0;
  const auto camera = camera_of(320, 240);
  for (float part : {0.1f, 0.5f, 0.83f}) {
    const float t = part * static_cast<float>(frames);
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

}  // namespace

TEST_CASE("pack reports the errors of the file that it wrote") {
  const TemporaryFolder folder;
  const std::string in = folder / "in.stgs", out = folder / "out.stgs";
  Scene scene = random_scene(3000, 2, 60, 13);
  scene.gaussians.opacity_logit[5] = -20.0f;  // never visible
  REQUIRE(write_scene(in, scene, {}).ok());
  encoder::PackReport report;
  const Status status = encoder::pack({in}, out, {}, &report);
  INFO(status.message());
  REQUIRE(status.ok());
  CHECK(report.primitives + report.dropped == 3000);
  CHECK(report.dropped >= 1);
  CHECK(report.bytes_in == std::filesystem::file_size(in));
  CHECK(report.bytes_out == std::filesystem::file_size(out));
  CHECK(report.bytes_out * 4 < report.bytes_in);
  CHECK(report.bytes_per_primitive == Approx(double(report.bytes_out) / double(report.primitives)));
  // A scene of 4 units whose small primitives measure 0.02: half a step is an eighth of that where
  // a primitive matters little.
  CHECK(report.position_max > 0.0);
  CHECK(report.position_max < 2e-2);
  CHECK(report.position_rms < report.position_max);
  CHECK(report.colour_rms < 4.0 / 255.0);
  CHECK(report.opacity_max < 0.08);  // half a step of 2^-2 of the logit, and an even opacity
  const auto read = SceneReader::open(out);
  REQUIRE(read.ok());
  CHECK((*read)->profile() == Profile::kQuantised);
  CHECK((*read)->primitives() == report.primitives);
  CHECK(encoder::pack({folder / "none.stgs"}, out, {}, nullptr).code() == StatusCode::kIo);
}

TEST_CASE("packing stops where it is told to, and then writes nothing") {
  const TemporaryFolder folder;
  const std::string in = folder / "in.stgs", out = folder / "out.stgs";
  REQUIRE(write_scene(in, random_scene(300, 0, 60, 13), {}).ok());
  for (int steps = 0;; ++steps) {
    double last = -1;
    int left = steps;
    const Status status = encoder::pack({in}, out, {}, nullptr, [&](const encoder::Progress& p) {
      CHECK(p.stage == "pack");
      CHECK(p.done > last);
      last = p.done;
      return left-- > 0;
    });
    if (last == 1) {  // told when the file is there: too late to stop
      CHECK(status.ok());
      CHECK(steps >= 2);
      CHECK(std::filesystem::exists(out));
      break;
    }
    CHECK(status.code() == StatusCode::kRuntime);
    CHECK_FALSE(std::filesystem::exists(out));
  }
}

namespace {

// A scene in a file of its own, and where to pack it to; gone at the end.
struct PackFixture {
  const TemporaryFolder folder;
  const std::string in = folder / "in.stgs", out = folder / "out.stgs";
  explicit PackFixture(Scene scene, bool with_camera = true) {
    if (with_camera) {
      StartCamera camera;
      camera.width = 160;
      camera.height = 120;
      camera.fx = camera.fy = 150;
      camera.cx = 80;
      camera.cy = 60;
      camera.translation[2] = 6;
      scene.metadata.start_camera = camera;
    }
    REQUIRE(write_scene(in, scene, {}).ok());
  }

  StatusCode pack(const encoder::PackSettings& settings, encoder::PackReport& report) const {
    const Status status = encoder::pack({in}, out, settings, &report);
    UNSCOPED_INFO(status.message());
    return status.code();
  }
};

}  // namespace

TEST_CASE("a bit rate is kept, and nearly used") {
  const PackFixture files(random_scene(4000, 2, 60, 15));
  encoder::PackReport plain, report;
  encoder::PackSettings settings;
  REQUIRE(files.pack(settings, plain) == StatusCode::kOk);
  CHECK(plain.quality == 87);
  CHECK(plain.kbps == Approx(static_cast<double>(plain.bytes_out) * 8e-3 / 2.0));
  for (const double share : {0.5, 0.9, 1.3}) {
    settings.target_kbps = share * plain.kbps;
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(report.kbps <= settings.target_kbps);
    CHECK(report.kbps >= 0.93 * settings.target_kbps);
    CHECK(report.bytes_out == std::filesystem::file_size(files.out));
    CHECK((report.quality < 87) == (share < 1));
  }
  settings.target_kbps = 1e6;  // more than all there is to tell
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.quality == 100);
  std::filesystem::remove(files.out);
  settings.target_kbps = 1;
  CHECK(files.pack(settings, report) == StatusCode::kUsage);
  CHECK_FALSE(std::filesystem::exists(files.out));
}

TEST_CASE("a bound on where primitives lie is kept at every moment") {
  const Scene scene = random_scene(4000, 0, 60, 16);
  const PackFixture files(scene);
  encoder::PackReport report;
  encoder::PackSettings settings;
  for (const double bound : {10.0, 1.0, 0.05}) {  // thousandths
    settings.max_error = bound;
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(report.position_max <= bound / 1000);
    CHECK(report.position_max > bound / 1e5);
    CHECK(report.position_rms < report.position_max);
  }
  settings.target_kbps = 0.8 * report.kbps;  // both are kept
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.position_max <= settings.max_error / 1000);
  CHECK(report.kbps <= settings.target_kbps);
  settings = {};
  settings.max_error = 1e-5;  // finer than the floats of a scene of 4 units
  std::filesystem::remove(files.out);
  CHECK(files.pack(settings, report) == StatusCode::kUnsupported);
  CHECK_FALSE(std::filesystem::exists(files.out));
}

TEST_CASE("a bound is kept within a bit rate, and the bound that can be kept is named") {
  Scene scene = random_scene(2000, 0, 60, 18);
  for (std::size_t i = 0; i < 2000; i += 7) {  // far and fast: its steps are as fine as they can be
    scene.gaussians.velocity[3 * i] *= 40.0f;
  }
  const PackFixture files(scene);
  encoder::PackReport report;
  encoder::PackSettings settings;
  settings.quality = 85;
  settings.max_error = 1e-4;
  const Status refused = encoder::pack({files.in}, files.out, settings, &report);
  REQUIRE(refused.code() == StatusCode::kUnsupported);
  const std::string before = "the smallest possible error is ", text = refused.message();
  const std::size_t at = text.find(before);
  REQUIRE(at != std::string::npos);
  settings.max_error = std::stod(text.substr(at + before.size()));
  CHECK(settings.max_error > 1e-4);
  CHECK(settings.max_error < 0.02);
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.position_max <= settings.max_error / 1000);
  // So near to what can be kept that no first bound on steps is enough.
  const double plain = report.kbps;
  for (const double share : {0.95, 0.9, 0.85}) {
    settings.target_kbps = share * plain;
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(report.kbps <= settings.target_kbps);
    CHECK(report.position_max <= settings.max_error / 1000);
  }
}

TEST_CASE("the bound that cannot be kept is told with what does not keep it") {
  const auto refused = [](const Scene& scene) {
    const PackFixture files(scene);
    encoder::PackSettings settings;
    settings.max_error = 1;
    const Status status = encoder::pack({files.in}, files.out, settings, nullptr);
    CHECK(status.code() == StatusCode::kUnsupported);
    return status.message();
  };
  Scene scene = random_scene(500, 0, 60, 40);
  const Scene plain = scene;
  scene.gaussians.velocity[3 * 77] = 1e6f;
  scene.gaussians.opacity_logit[77] = 2.0f;
  CHECK_THAT(refused(scene), Catch::Contains("moves by 1e+06 units per frame"));
  scene = plain;  // it has come far when it is seen
  scene.gaussians.position[3 * 77] = 1.0f;
  std::fill_n(&scene.gaussians.velocity[3 * 77], 3, 0.5f);
  scene.gaussians.time[77] = -1e5f;
  scene.gaussians.radius[77] = 1e5f + 20;
  scene.gaussians.opacity_logit[77] = 2.0f;
  CHECK_THAT(refused(scene), Catch::Contains("primitive 77 is at (50001, "));
  scene = plain;
  for (const std::size_t i : {78, 79}) {  // far from the others, and from each other
    scene.gaussians.position[3 * i] = i == 78 ? 1e6f : -1e6f;
    scene.gaussians.opacity_logit[i] = 2.0f;
  }
  CHECK_THAT(refused(scene),
             Catch::Contains("positions have 21 bits") && Catch::Contains("e+06, "));
}

namespace {

struct Errors {
  double position = 0, colour = 0;  // rms
};

// Of the first `count` primitives, which stand still.
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

Scene still_scene() {
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

TEST_CASE("one primitive that is huge, or lies far out, leaves the others their steps") {
  const Scene plain = still_scene();
  const Errors own = errors_of_first(3000, plain);
  for (const float size : {2.0f, 4.0f, 7.0f, 60.0f}) {
    Scene scene = plain;
    std::fill_n(&scene.gaussians.log_scale[3 * 3000], 3, size);
    const Errors errors = errors_of_first(3000, scene);
    INFO("log-scale " << size);
    CHECK(errors.position < 1.15 * own.position);
    CHECK(errors.colour < 1.2 * own.colour);
  }
  for (const float far : {1e4f, 1e5f, 1e6f, 1e20f}) {
    Scene scene = plain;
    scene.gaussians.position[3 * 3000] = far;
    scene.gaussians.position[3 * 2999] = 3e4f;  // another distance
    const Errors errors = errors_of_first(2999, scene);
    INFO("at " << far);
    CHECK(errors.position < 1.05 * own.position);
    CHECK(errors.colour < 1.05 * own.colour);
  }
}

TEST_CASE("what steps do not reach is refused with where it lies") {
  Scene scene = still_scene();
  scene.gaussians.position[3 * 5 + 1] = 1e30f;
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  const auto file = encode_scene(scene, settings);
  CHECK(file.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(file.status().message(), Catch::Contains(", 1e+30, "));
}

TEST_CASE("packing reports what it did to lifespans") {
  Scene scene = random_scene(500, 0, 60, 19);
  std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), 3.0f);
  const PackFixture files(scene);
  encoder::PackReport fine, coarse;
  encoder::PackSettings settings;
  settings.quality = 95;
  REQUIRE(files.pack(settings, fine) == StatusCode::kOk);
  settings.quality = 60;
  REQUIRE(files.pack(settings, coarse) == StatusCode::kOk);
  for (const encoder::PackReport* report : {&fine, &coarse}) {
    CHECK(report->time_max > 0);
    CHECK(report->radius_max > 0);
    CHECK(report->sigma_max > 0);
    CHECK(report->visibility_max > 0);
  }
  CHECK(fine.time_max <= 0.13);
  CHECK(fine.time_max < coarse.time_max);
  CHECK(fine.sigma_max < 0.12);
  CHECK(fine.sigma_max < coarse.sigma_max);
  CHECK(fine.visibility_max < coarse.visibility_max);
}

TEST_CASE("packing measures its pictures") {
  const Scene scene = random_scene(4000, 1, 60, 17);
  encoder::PackReport good, poor;
  encoder::PackSettings settings;
  {
    const PackFixture files(scene);
    settings.quality = 95;
    REQUIRE(files.pack(settings, good) == StatusCode::kOk);
    settings.quality = 30;
    REQUIRE(files.pack(settings, poor) == StatusCode::kOk);
    REQUIRE((good.images_psnr && poor.images_psnr));
    CHECK(*good.images_psnr > *poor.images_psnr + 6);
    CHECK(*good.images_psnr < 90);  // they show something
    settings.against = files.folder / "none";
    CHECK(files.pack(settings, poor) == StatusCode::kIo);
  }
  const PackFixture files(scene, false);
  REQUIRE(files.pack({}, good) == StatusCode::kOk);
  CHECK_FALSE(good.images_psnr);
}

TEST_CASE("what stands still is exactly still after packing") {
  Scene scene = random_scene(500, 0, 60, 14);
  std::fill(scene.gaussians.velocity.begin(), scene.gaussians.velocity.end(), 0.0f);
  for (float v : quantised(scene, 85).velocity) CHECK(v == 0.0f);
}

TEST_CASE("the quantised profile draws what the lossless one draws") {
  const Scene scene = random_scene(20000, 3, 60, 11);
  CHECK(psnr(scene.gaussians, quantised(scene, 85), 60) >= 38.0);
  CHECK(psnr(scene.gaussians, quantised(scene, 95), 60) >= 45.0);
}

TEST_CASE("more quality is more bytes and a better picture") {
  const Scene scene = random_scene(5000, 2, 60, 12);
  std::uint64_t last_bytes = 0;
  double last_psnr = 15.0;  // at quality 0 something can be recognised still
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

TEST_CASE("what hardly changes and stands still costs next to no time") {
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
  std::uint64_t temporal = 0;
  for (const StreamInfo& stream : (*reader)->streams()) {
    if (stream.name != "time" && stream.name != "sigma" && stream.name != "radius") continue;
    temporal += stream.bytes;
  }
  CHECK(temporal < 400);
  CHECK(psnr(set, quantised(scene, 85), 60) >= 38.0);
}

TEST_CASE("first tiers and missing harmonics are pictures, each better than the one before") {
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
  for (const auto& [tiers, harmonics] : {std::pair{1, false}, {2, false}, {3, false}, {3, true}}) {
    Gaussians4D drawn;
    drawn.sh_degree = 2;
    for (std::uint32_t s = 0; s < (*reader)->segments().size(); ++s) {
      if ((*reader)->segments()[s].tier >= tiers) continue;
      const auto set = (*reader)->decode(s, harmonics);
      REQUIRE(set.ok());
      for (std::size_t i = 0; i < set->size(); ++i) drawn.append(*set, i);
    }
    const double db = psnr(scene.gaussians, drawn, 60);
    INFO(tiers << " tiers, " << (harmonics ? "with" : "without") << " harmonics: " << db << " dB");
    CHECK(db > last + 0.5);
    last = db;
  }
}

TEST_CASE("a lossless scene keeps its importances, each with its primitive") {
  Scene scene = random_scene(500, 1, 60, 17);
  for (std::size_t i = 0; i < 500; ++i) {
    scene.importance.push_back(scene.gaussians.position[3 * i] + 10.0f);
  }
  const auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  const auto read = read_scene(memory_source(*bytes));
  REQUIRE(read.ok());
  REQUIRE(read->importance.size() == 500);
  for (std::size_t i = 0; i < 500; ++i) {
    CHECK(read->importance[i] == read->gaussians.position[3 * i] + 10.0f);
  }
  std::vector<std::uint8_t> damaged = *bytes;
  damaged[testing::copy_at(damaged) - 1] ^= 1;
  CHECK(read_scene(memory_source(damaged)).status().code() == StatusCode::kInvalidFile);
  scene.importance[3] = -1.0f;
  CHECK(encode_scene(scene, {}).status().code() == StatusCode::kUsage);
}
