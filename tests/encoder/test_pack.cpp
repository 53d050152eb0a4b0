// SPDX-License-Identifier: Apache-2.0
// Packing of files: reported errors, cancellation, target bit rate and position error bound.
#include "stgs/encoder/pack.h"

#include <filesystem>

#include "catch.h"
#include "fixtures/copy_fixture.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/temporary_folder.h"

using namespace stgs;
using stgs::testing::random_scene;
using stgs::testing::TemporaryFolder;

TEST_CASE("pack reports the errors of the file that it writes") {
  const TemporaryFolder folder;
  const std::string in = folder / "in.stgs", out = folder / "out.stgs";
  Scene scene = random_scene(3000, 2, 60, 13);
  scene.gaussians.opacity_logit[5] = -20.0f;  // never visible
  REQUIRE(write_scene(in, scene, {}).ok());
  encoder::PackReport report;
  const Status status = encoder::pack(in, out, {}, &report);
  INFO(status.message());
  REQUIRE(status.ok());
  CHECK(report.primitives + report.dropped == 3000);
  CHECK(report.dropped >= 1);
  CHECK(report.bytes_in == std::filesystem::file_size(in));
  CHECK(report.bytes_out == std::filesystem::file_size(out));
  CHECK(report.bytes_out * 4 < report.bytes_in);
  CHECK(report.bytes_per_primitive == Approx(double(report.bytes_out) / double(report.primitives)));
  // The scene spans 4 units, and its small primitives measure 0.02: half a step is an eighth
  // of that for primitives of low importance.
  CHECK(report.position_max > 0.0);
  CHECK(report.position_max < 2e-2);
  CHECK(report.position_rms < report.position_max);
  CHECK(report.colour_rms < 4.0 / 255.0);
  CHECK(report.opacity_max < 0.08);  // half a step of 2^-2 in the logit, at opacity 0.5
  const auto read = SceneReader::open(out);
  REQUIRE(read.ok());
  CHECK((*read)->profile() == Profile::kQuantised);
  CHECK((*read)->primitives() == report.primitives);
  CHECK(encoder::pack(folder / "none.stgs", out, {}, nullptr).code() == StatusCode::kIo);
}

TEST_CASE("packing can be cancelled at any step and then writes no file") {
  const TemporaryFolder folder;
  const std::string in = folder / "in.stgs", out = folder / "out.stgs";
  REQUIRE(write_scene(in, random_scene(300, 0, 60, 13), {}).ok());
  for (int steps = 0;; ++steps) {
    double last = -1;
    int left = steps;
    const Status status = encoder::pack(in, out, {}, nullptr, [&](const encoder::Progress& p) {
      CHECK(p.stage == "pack");
      CHECK(p.done > last);
      last = p.done;
      return left-- > 0;
    });
    if (last == 1) {  // reported after the file is complete: too late to cancel
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

// A scene in a temporary file, and the path to pack it to.
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
    const Status status = encoder::pack(in, out, settings, &report);
    UNSCOPED_INFO(status.message());
    return status.code();
  }
};

}  // namespace

TEST_CASE("the packed file meets the target bit rate and uses most of it") {
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
  settings.target_kbps = 1e6;  // more than the best quality needs
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.quality == 100);
  std::filesystem::remove(files.out);
  settings.target_kbps = 1;
  CHECK(files.pack(settings, report) == StatusCode::kUsage);
  CHECK_FALSE(std::filesystem::exists(files.out));
}

TEST_CASE("a low limit leaves out the primitives of least importance") {
  Scene scene = random_scene(4000, 2, 60, 15);
  for (std::size_t i = 0; i < 4000; ++i) scene.importance.push_back(static_cast<float>(i % 1000));
  const PackFixture files(scene);
  encoder::PackReport plain, report;
  encoder::PackSettings settings;
  REQUIRE(files.pack(settings, plain) == StatusCode::kOk);
  double before = 0;
  for (const double share : {0.1, 0.3}) {
    settings.target_size = share * static_cast<double>(plain.bytes_out);
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(static_cast<double>(report.bytes_out) <= settings.target_size);
    CHECK(static_cast<double>(report.bytes_out) >= 0.9 * settings.target_size);
    CHECK(report.quality == 70);
    CHECK(report.left_out > 0);
    CHECK(report.primitives + report.dropped + report.left_out == 4000);
    CHECK(*report.images_psnr > before);  // more bytes are never worse
    before = *report.images_psnr;
  }
  settings.target_kbps = 100;
  CHECK(files.pack(settings, report) == StatusCode::kUsage);
}

TEST_CASE("a target PSNR gives the smallest file that reaches it") {
  const PackFixture files(random_scene(2000, 1, 60, 15));
  encoder::PackReport report;
  encoder::PackSettings settings;
  std::uint64_t before = 0;
  for (const double target : {30.0, 40.0}) {
    settings.target_psnr = target;
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(*report.images_psnr >= target);
    CHECK(*report.images_psnr < target + 3);
    CHECK(report.bytes_out > before);
    before = report.bytes_out;
  }
  settings.target_psnr = 99;
  CHECK(files.pack(settings, report) == StatusCode::kUsage);
  const PackFixture without_camera(random_scene(100, 1, 60, 15), false);
  settings.target_psnr = 30;
  CHECK(without_camera.pack(settings, report) == StatusCode::kUsage);
}

TEST_CASE("the position error bound holds at every time") {
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
  settings.target_kbps = 0.8 * report.kbps;  // both hold
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.position_max <= settings.max_error / 1000);
  CHECK(report.kbps <= settings.target_kbps);
  settings = {};
  settings.max_error = 1e-5;  // finer than the floats of a scene of 4 units
  std::filesystem::remove(files.out);
  CHECK(files.pack(settings, report) == StatusCode::kUnsupported);
  CHECK_FALSE(std::filesystem::exists(files.out));
}

TEST_CASE("the error names the smallest possible bound, which then holds within a bit rate") {
  Scene scene = random_scene(2000, 0, 60, 18);
  for (std::size_t i = 0; i < 2000; i += 7) {  // so fast that steps reach their minimum
    scene.gaussians.velocity[3 * i] *= 40.0f;
  }
  const PackFixture files(scene);
  encoder::PackReport report;
  encoder::PackSettings settings;
  settings.quality = 85;
  settings.max_error = 1e-4;
  const Status rejection = encoder::pack(files.in, files.out, settings, &report);
  REQUIRE(rejection.code() == StatusCode::kUnsupported);
  const std::string before = "the smallest possible error is ", text = rejection.message();
  const std::size_t at = text.find(before);
  REQUIRE(at != std::string::npos);
  settings.max_error = std::stod(text.substr(at + before.size()));
  CHECK(settings.max_error > 1e-4);
  CHECK(settings.max_error < 0.02);
  REQUIRE(files.pack(settings, report) == StatusCode::kOk);
  CHECK(report.position_max <= settings.max_error / 1000);
  // So close to the limit that the first choice of steps does not suffice.
  const double plain = report.kbps;
  for (const double share : {0.95, 0.9, 0.85}) {
    settings.target_kbps = share * plain;
    REQUIRE(files.pack(settings, report) == StatusCode::kOk);
    CHECK(report.kbps <= settings.target_kbps);
    CHECK(report.position_max <= settings.max_error / 1000);
  }
}

TEST_CASE("an impossible bound is rejected, naming the primitive or range that exceeds it") {
  const auto rejection = [](const Scene& scene) {
    const PackFixture files(scene);
    encoder::PackSettings settings;
    settings.max_error = 1;
    const Status status = encoder::pack(files.in, files.out, settings, nullptr);
    CHECK(status.code() == StatusCode::kUnsupported);
    return status.message();
  };
  Scene scene = random_scene(500, 0, 60, 40);
  const Scene plain = scene;
  scene.gaussians.velocity[3 * 77] = 1e6f;
  scene.gaussians.opacity_logit[77] = 2.0f;
  CHECK_THAT(rejection(scene), Catch::Contains("moves by 1e+06 units per frame"));
  scene = plain;  // far from its position when it becomes visible
  scene.gaussians.position[3 * 77] = 1.0f;
  std::fill_n(&scene.gaussians.velocity[3 * 77], 3, 0.5f);
  scene.gaussians.time[77] = -1e5f;
  scene.gaussians.radius[77] = 1e5f + 20;
  scene.gaussians.opacity_logit[77] = 2.0f;
  CHECK_THAT(rejection(scene), Catch::Contains("primitive 77 is at (50001, "));
  scene = plain;
  for (const std::size_t i : {78, 79}) {  // far from the others and from each other
    scene.gaussians.position[3 * i] = i == 78 ? 1e6f : -1e6f;
    scene.gaussians.opacity_logit[i] = 2.0f;
  }
  CHECK_THAT(rejection(scene),
             Catch::Contains("positions have 21 bits") && Catch::Contains("e+06, "));
}

TEST_CASE("pack reports the errors of lifespans") {
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

TEST_CASE("pack measures the PSNR of rendered images") {
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
    CHECK(*good.images_psnr < 90);  // the images are not empty
    settings.against = files.folder / "none";
    CHECK(files.pack(settings, poor) == StatusCode::kIo);
  }
  const PackFixture files(scene, false);
  REQUIRE(files.pack({}, good) == StatusCode::kOk);
  CHECK_FALSE(good.images_psnr);
}

TEST_CASE("a lossless file stores the importance of each primitive") {
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
