// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/ply_sequence.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <numeric>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/output_file.h"
#include "stgs/format/raster.h"

using namespace stgs;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

constexpr int kFrames = 12;
constexpr std::size_t kStatic = 500, kMoving = 80, kAppearing = 60, kDisappearing = 60;
constexpr int kFirstShown = 5;   // first frame with the appearing splats
constexpr int kFirstHidden = 7;  // first frame without the disappearing splats

struct Folder : testing::TemporaryFolder {
  void write(int frame, const Gaussians4D& set) const {
    const auto bytes = write_ply(set);
    REQUIRE(bytes.ok());
    REQUIRE(write_file_atomically(fmt::format("{}/{:05}.ply", path, frame), *bytes).ok());
  }
};

// Displacement of splat i from its position in the first frame.
using Motion = std::function<float(std::size_t i, int frame, std::size_t axis)>;

// The frames of a model whose splats are, in order, static, moving, appearing and disappearing.
std::vector<Gaussians4D> make_frames(const Motion& motion) {
  Gaussians4D model =
      testing::random_scene(kStatic + kMoving + kAppearing + kDisappearing, 1, 1, 11).gaussians;
  for (float& s : model.log_scale) s += 1.2f;
  std::vector<Gaussians4D> frames;
  for (int f = 0; f < kFrames; ++f) {
    Gaussians4D frame;
    frame.sh_degree = 1;
    for (std::size_t i = 0; i < model.size(); ++i) {
      const bool appearing = i >= kStatic + kMoving && i < kStatic + kMoving + kAppearing;
      const bool disappearing = i >= kStatic + kMoving + kAppearing;
      if ((appearing && f < kFirstShown) || (disappearing && f >= kFirstHidden)) continue;
      frame.append(model, i);
      if (i < kStatic || i >= kStatic + kMoving) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        frame.position[3 * frame.size() - 3 + c] += motion(i, f, c);
      }
    }
    set_static_lifespan(frame);
    frames.push_back(std::move(frame));
  }
  return frames;
}

float linear(std::size_t i, int frame, std::size_t axis) {
  return 0.01f * static_cast<float>(frame) * (axis == i % 3 ? 1.0f : -0.5f);
}

float circular(std::size_t i, int frame, std::size_t axis) {
  const float angle = 0.3f * static_cast<float>(frame) + static_cast<float>(i);
  const float start = static_cast<float>(i);
  return axis == 0   ? 0.3f * (std::cos(angle) - std::cos(start))
         : axis == 1 ? 0.3f * (std::sin(angle) - std::sin(start))
                     : 0.0f;
}

Gaussians4D shuffled(const Gaussians4D& set, unsigned seed) {
  std::vector<std::uint32_t> order(set.size());
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(order.begin(), order.end(), std::mt19937(seed));
  return set.gather(order);
}

Image render_at(const Gaussians4D& set, double ticks) {
  math::PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.fx = camera.fy = 150;
  camera.cx = 100;
  camera.cy = 75;
  camera.width = 200;
  camera.height = 150;
  camera.near_plane = 0.1f;
  SplatFrame splats;
  RasterOutput output;
  render(set, static_cast<float>(ticks), camera, {}, splats, output);
  return output.colour;
}

double psnr(const Image& a, const Image& b) {
  double square = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    const double d = std::clamp(a.data[i], 0.0f, 1.0f) - std::clamp(b.data[i], 0.0f, 1.0f);
    square += d * d;
  }
  return -10 * std::log10(square / static_cast<double>(a.data.size()) + 1e-20);
}

// The lowest PSNR between the scene, rendered at the time of each frame, and the frames.
double lowest_psnr(const Scene& scene, const std::vector<Gaussians4D>& frames) {
  double lowest = 1000;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    lowest = std::min(
        lowest, psnr(render_at(scene.gaussians, static_cast<double>(f)), render_at(frames[f], 0)));
  }
  return lowest;
}

Result<Scene> read(const Folder& folder, const std::vector<Gaussians4D>& frames,
                   SequenceReport& report, const SequenceSettings& settings = {}) {
  for (std::size_t f = 0; f < frames.size(); ++f) folder.write(static_cast<int>(f), frames[f]);
  return read_ply_sequence(folder.path, settings, {}, &report);
}

}  // namespace

TEST_CASE("PLY sequence: a static, moving, appearing or disappearing splat is one primitive") {
  const Folder folder;
  std::vector<Gaussians4D> frames = make_frames(linear);
  const bool permuted = GENERATE(false, true);
  if (permuted) {
    for (std::size_t f = 0; f < frames.size(); ++f) {
      frames[f] = shuffled(frames[f], static_cast<unsigned>(f));
    }
  }
  SequenceReport report;
  const Result<Scene> scene = read(folder, frames, report);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == kFrames);
  CHECK(scene->gaussians.size() == kStatic + kMoving + kAppearing + kDisappearing);
  CHECK(report.frames == kFrames);
  CHECK(report.primitives == scene->gaussians.size());
  CHECK(report.splats == kFrames * (kStatic + kMoving) + kAppearing * (kFrames - kFirstShown) +
                             kDisappearing * kFirstHidden);
  CHECK(report.whole_clip == kStatic + kMoving);
  CHECK(report.moving == kMoving);
  CHECK(report.matched() > 0.98);  // appearing splats begin new primitives
  CHECK(report.errors.colour == 0.0);
  CHECK(lowest_psnr(*scene, frames) > 60);
  const auto& velocity = scene->gaussians.velocity;
  std::size_t static_count = 0;
  for (std::size_t i = 0; i < scene->gaussians.size(); ++i) {
    static_count += velocity[3 * i] == 0 && velocity[3 * i + 1] == 0 && velocity[3 * i + 2] == 0;
  }
  CHECK(static_count == scene->gaussians.size() - kMoving);
}

TEST_CASE("PLY sequence: a frame is shown for half a frame before and after its time") {
  const Folder folder;
  std::vector<Gaussians4D> frames = make_frames([](std::size_t, int, std::size_t) { return 0.0f; });
  SequenceReport report;
  const Result<Scene> scene = read(folder, frames, report);
  REQUIRE(scene.ok());
  for (const double around : {-0.49, -0.1, 0.0, 0.25, 0.49}) {
    CHECK(psnr(render_at(scene->gaussians, kFirstShown + around),
               render_at(frames[static_cast<std::size_t>(kFirstShown)], 0)) > 60);
    CHECK(psnr(render_at(scene->gaussians, kFirstHidden - 1 + around),
               render_at(frames[static_cast<std::size_t>(kFirstHidden - 1)], 0)) > 60);
  }
  // Where two frames meet, there is neither a gap nor an overlap.
  CHECK(psnr(render_at(scene->gaussians, kFirstShown - 0.5),
             render_at(frames[static_cast<std::size_t>(kFirstShown)], 0)) > 60);
  // The last frame lasts to the end of the clip.
  CHECK(psnr(render_at(scene->gaussians, kFrames), render_at(frames.back(), 0)) > 60);
}

TEST_CASE("PLY sequence: a curved path becomes a few straight segments") {
  const Folder folder;
  const std::vector<Gaussians4D> frames = make_frames(circular);
  SequenceReport report;
  const Result<Scene> scene = read(folder, frames, report);
  REQUIRE(scene.ok());
  const std::size_t others = kStatic + kAppearing + kDisappearing;
  CHECK(scene->gaussians.size() >= others + kMoving);
  CHECK(scene->gaussians.size() <= others + kMoving * kFrames * 2 / 3);
  CHECK(report.errors.position <= 0.02);
  CHECK(lowest_psnr(*scene, frames) >= 50);
}

TEST_CASE("PLY sequence: splats within the tolerances are joined, and the error is reported") {
  const Folder folder;
  std::vector<Gaussians4D> frames = make_frames(linear);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> noise(-1, 1);
  for (std::size_t f = 1; f < frames.size(); ++f) {
    for (float& v : frames[f].log_scale) v += 0.005f * noise(random);
    for (float& v : frames[f].opacity_logit) v += 0.005f * noise(random);
    for (float& v : frames[f].sh) v += 0.0002f * noise(random);
  }
  SequenceReport report;
  Result<Scene> scene = read(folder, frames, report);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() == kStatic + kMoving + kAppearing + kDisappearing);
  CHECK(report.errors.log_scale > 0.004);
  CHECK(report.errors.log_scale <= 0.010001);  // the sum for two noisy frames
  CHECK(report.errors.opacity > 0.0005);
  CHECK(report.errors.opacity <= 0.00251);
  CHECK(report.errors.colour > 0);
  CHECK(lowest_psnr(*scene, frames) >= 50);
  // Zero tolerances join nothing, and the frames are still reproduced.
  SequenceSettings exact;
  exact.tolerances = {0, 0, 0, 0, 0};
  scene = read_ply_sequence(folder.path, exact, {}, &report);
  REQUIRE(scene.ok());
  CHECK(report.matched() == 0.0);
  CHECK(scene->gaussians.size() == report.splats);
  CHECK(lowest_psnr(*scene, frames) > 60);
}

TEST_CASE("PLY sequence: a change of colour begins a new primitive") {
  const Folder folder;
  std::vector<Gaussians4D> frames = make_frames(linear);
  for (std::size_t f = 6; f < frames.size(); ++f) frames[f].sh[0] += 0.1f;  // of the first splat
  SequenceReport report;
  const Result<Scene> scene = read(folder, frames, report);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() == kStatic + kMoving + kAppearing + kDisappearing + 1);
  CHECK(lowest_psnr(*scene, frames) > 60);
}

TEST_CASE("PLY sequence: a single frame is a static model") {
  const Folder folder;
  SequenceReport report;
  const Result<Scene> scene = read(folder, {make_frames(linear)[0]}, report);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 1);
  CHECK(report.matched() == 1.0);
  CHECK(report.whole_clip == scene->gaussians.size());
  CHECK(scene->gaussians.time[0] == 0.5f);
  CHECK(scene->gaussians.radius[0] == 1.0f);
  CHECK(scene->gaussians.sigma[0] == 1.0f);
}

TEST_CASE("PLY sequence: folders that are not a sequence are rejected") {
  const Folder folder;
  const auto code = [&](const ReadLimits& limits = {}) {
    return read_ply_sequence(folder.path, {}, limits).status().code();
  };
  CHECK(code() == StatusCode::kIo);  // empty
  CHECK_FALSE(is_ply_sequence(folder.path));
  const Gaussians4D set = testing::random_scene(30, 0, 1, 2).gaussians;
  for (int f : {3, 5, 7}) folder.write(f, set);  // every second frame
  CHECK(is_ply_sequence(folder.path));
  CHECK(code() == StatusCode::kOk);
  folder.write(10, set);
  CHECK_THAT(read_ply_sequence(folder.path).status().message(), Contains("frames missing after"));
  fs::rename(folder / "00010.ply", folder / "007.ply");
  CHECK_THAT(read_ply_sequence(folder.path).status().message(), Contains("the same frame"));
  fs::rename(folder / "007.ply", folder / "model.ply");
  CHECK_THAT(read_ply_sequence(folder.path).status().message(), Contains("no frame number"));
  fs::rename(folder / "model.ply", folder / "99999999999999999999999.ply");
  CHECK(code() == StatusCode::kUsage);
  fs::remove(folder / "99999999999999999999999.ply");
  folder.write(9, testing::random_scene(30, 1, 1, 2).gaussians);
  CHECK_THAT(read_ply_sequence(folder.path).status().message(), Contains("degree"));
  fs::resize_file(folder / "00009.ply", fs::file_size(folder / "00009.ply") - 1);
  CHECK(code() == StatusCode::kInvalidFile);
  fs::remove(folder / "00009.ply");
  // Each frame is within the limit, the resulting scene is not.
  folder.write(9, testing::random_scene(30, 0, 1, 3).gaussians);
  ReadLimits limits;
  limits.max_primitives = 59;
  CHECK(code(limits) == StatusCode::kUnsupported);
}

TEST_CASE("PLY sequence: thousands of coincident splats are matched in bounded time") {
  const Folder folder;
  Gaussians4D set = testing::random_scene(6000, 0, 1, 4).gaussians;
  std::fill(set.position.begin(), set.position.end(), 1.0f);
  SequenceReport report;
  const Result<Scene> scene = read(folder, {set, shuffled(set, 1), shuffled(set, 2)}, report);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() >= 6000);
}
