// SPDX-License-Identifier: Apache-2.0
// Static content that is moved in mid-capture: its persistent primitives end, and nothing else.
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "catch.h"
#include "fixtures/file_bytes.h"
#include "fixtures/played_psnr.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/encoder/stream_encoder.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/math/sh.h"
#include "train/scene_changes.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

constexpr int kCameras = 8, kFrames = 24, kWindow = 6;
constexpr int kLeaves = 14, kArrives = 16;  // frames of the move, in the third window
const math::Vec3 kOld{0.4f, 0.35f, 2.5f}, kNew{-0.45f, 0.45f, 2.4f};

TrainSettings settings_of(int iterations) {
  TrainSettings settings = test::short_run(iterations);
  settings.max_primitives = 1200;
  settings.held_out_evaluations = 0;
  return settings;
}

PreparedCapture window_at(const SyntheticCapture& synthetic, int begin) {
  const auto window = extract_window(synthetic.capture, {begin, begin + kWindow});
  REQUIRE(window.ok());
  return *window;
}

// The capture with images of twice the width and height, with the same content.
PreparedCapture doubled(const PreparedCapture& capture) {
  PreparedCapture out = capture;
  out.memory = std::make_shared<FrameMemory>();
  for (Camera& camera : out.cameras) {
    for (int f = 0; f < capture.frames; ++f) {
      const auto image = load_frame(capture, camera, f);
      REQUIRE(image.ok());
      Image8 large{2 * image->width, 2 * image->height, 3, {}};
      for (int y = 0; y < large.height; ++y) {
        for (int x = 0; x < 3 * large.width; ++x)
          large.data.push_back(image->data[3 * (y / 2 * image->width + x / 6) + x % 3]);
      }
      out.memory->add_frame(camera.name, f, std::move(large));
    }
    camera.width *= 2;
    camera.height *= 2;
    for (double* value : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *value *= 2;
  }
  return out;
}

// Whether a position is in the box, or next to it.
bool in_box(const float* p, const math::Vec3& box, float margin) {
  return std::abs(p[0] - box.x) < test::kBoxSize[0] + margin &&
         std::abs(p[1] - box.y) < test::kBoxSize[1] + margin &&
         std::abs(p[2] - box.z) < test::kBoxSize[2] + margin;
}

PersistentSet trained(const SyntheticCapture& synthetic, int begin, int iterations,
                      const PersistentSet& before = PersistentSet()) {
  PersistentSet set = before;
  const auto scene = train(window_at(synthetic, begin), settings_of(iterations), nullptr, nullptr,
                           nullptr, {&set, nullptr});
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  return set;
}

SceneChanges changes_in(const SyntheticCapture& synthetic, int begin, const PersistentSet& set) {
  auto changes = find_changes(window_at(synthetic, begin), *set.state(), set.residuals(),
                              math::kBandLimited, 200);
  INFO(changes.status().message());
  REQUIRE(changes.ok());
  return *changes;
}

// The share of the stored primitives, of several windows, that have one of another window at the
// same place with a similar colour.
double repeated_share(const Gaussians4D& set, const std::vector<int>& windows) {
  const auto n = static_cast<std::size_t>(set.sh_coefficients());
  std::size_t repeated = 0;
  for (std::size_t i = 0; i < windows.size(); ++i) {
    const float* p = &set.position[3 * i];
    const float* s = &set.log_scale[3 * i];
    const float reach = 0.5f * std::exp((s[0] + s[1] + s[2]) / 3);
    bool found = false;
    for (std::size_t j = 0; j < windows.size() && !found; ++j) {
      if (windows[j] == windows[i]) continue;
      const float* q = &set.position[3 * j];
      float colour = 0;
      for (std::size_t c = 0; c < 3; ++c)
        colour =
            std::max(colour, math::kSh00 * std::abs(set.sh[3 * n * i + c] - set.sh[3 * n * j + c]));
      found = std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) < reach && colour < 0.1f;
    }
    repeated += found ? 1 : 0;
  }
  return static_cast<double>(repeated) / static_cast<double>(windows.size());
}

// The area of the held-out camera in which a box is visible.
test::Area area_of(const SyntheticCapture& synthetic, const math::Vec3& box) {
  const math::PinholeCamera camera =
      synthetic.capture.cameras.front().pinhole(synthetic.capture.near_plane);
  const math::Vec3 c = math::to_camera(camera, {box.x, box.y, box.z - test::kBoxSize[2]});
  const float u = camera.fx * c.x / c.z + camera.cx, v = camera.fy * c.y / c.z + camera.cy;
  const float half = camera.fx * test::kBoxSize[0] / c.z + 1;
  return {static_cast<int>(u - half), static_cast<int>(v - half), static_cast<int>(u + half),
          std::min(static_cast<int>(v + half), static_cast<int>(camera.height))};
}

double mean_of(const std::vector<double>& values, int begin, int end) {
  return test::mean_of({values.begin() + begin, values.begin() + end});
}

}  // namespace

TEST_CASE("primitives of a moved box end when it leaves, and others stay") {
  const SyntheticCapture synthetic(kCameras,
                                   test::box_move(kFrames, kOld, kNew, kLeaves, kArrives));
  PersistentSet set = trained(synthetic, 0, 600);
  const Gaussians4D first = set.state()->set;
  const std::size_t stored = set.size();
  std::size_t old_box = 0;
  for (std::size_t i = 0; i < stored; ++i)
    old_box += in_box(&first.position[3 * i], kOld, 0.05f) ? 1 : 0;
  REQUIRE(old_box > 100);

  const SceneChanges none = changes_in(synthetic, kWindow, set);
  CHECK(none.ended.empty());
  CHECK(none.points.size() <= 5);

  set = trained(synthetic, kWindow, 300, set);
  CHECK(set.ends().empty());
  CHECK(static_cast<double>(set.size()) < 1.02 * static_cast<double>(stored));
  const SceneChanges moved = changes_in(synthetic, 2 * kWindow, set);
  std::size_t in_old = 0, elsewhere = 0;
  for (const EndedPrimitive& ended : moved.ended) {
    CHECK(std::abs(2 * kWindow + ended.frame - kLeaves) <= 1);
    const float* p = &set.state()->set.position[3 * std::size_t{ended.index}];
    in_old += in_box(p, kOld, 0.05f) ? 1 : 0;
    elsewhere += in_box(p, kOld, 0.15f) ? 0 : 1;
  }
  CAPTURE(old_box, in_old, elsewhere, moved.ended.size());
  CHECK(static_cast<double>(in_old) >= 0.75 * static_cast<double>(old_box));
  CHECK(static_cast<double>(elsewhere) <= 0.01 * static_cast<double>(stored));
  // Residuals of images of another size do not count.
  const std::vector<Residual> other(set.residuals().size(), Residual(7, 0));
  const auto ended_with = [&](const std::vector<Residual>& residuals) {
    return find_changes(window_at(synthetic, 2 * kWindow), *set.state(), residuals,
                        math::kBandLimited, 200)
        ->ended.size();
  };
  CHECK(ended_with(other) == ended_with({}));

  std::vector<int> windows(set.size(), 0);
  for (int begin = 2 * kWindow; begin < kFrames; begin += kWindow) {
    const PersistentSet before = set;
    set = trained(synthetic, begin, 300, before);
    // Those that did not end are first and the same to the bit.
    const std::size_t remaining = before.size() - set.ends().size();
    REQUIRE(set.size() >= remaining);
    const std::vector<int> ends =
        ends_of_fixed(*before.state(), changes_in(synthetic, begin, before));
    std::vector<std::uint32_t> kept;
    std::size_t rank = 0;
    for (std::size_t i = 0; i < before.state()->size(); ++i)
      if (before.state()->is_fixed(i) && ends[rank++] < 0)
        kept.push_back(static_cast<std::uint32_t>(i));
    REQUIRE(kept.size() == remaining);
    std::vector<std::uint32_t> now(remaining);
    for (std::size_t k = 0; k < remaining; ++k) now[k] = static_cast<std::uint32_t>(k);
    CHECK(test::same(before.state()->set.gather(kept), set.state()->set.gather(now)));
    std::vector<int> next;
    for (std::size_t k = 0; k < ends.size(); ++k)
      if (ends[k] < 0) next.push_back(windows[k]);
    windows = next;
    windows.resize(set.size(), begin);
  }
  CHECK(static_cast<double>(set.size()) < 1.1 * static_cast<double>(stored));
  const double repeated = repeated_share(set.state()->set, windows);
  CAPTURE(repeated);
  CHECK(repeated <= 0.01);
}

TEST_CASE("a person who passes or stands in front of static content ends nothing") {
  std::vector<math::Vec3> path =
      test::box_move(3 * kWindow, {3, 0, 2}, {0.2f, 0, 2.2f}, kWindow + 1, 2 * kWindow - 1);
  const SyntheticCapture synthetic(kCameras, path);
  const PersistentSet set = trained(synthetic, 0, 600);
  for (const int begin : {kWindow, 2 * kWindow}) {
    const SceneChanges changes = changes_in(synthetic, begin, set);
    CHECK(changes.ended.empty());
  }
}

TEST_CASE("a file shows a moved box at its new place within a window, also after a resumed run") {
  const SyntheticCapture synthetic(kCameras,
                                   test::box_move(kFrames, kOld, kNew, kLeaves, kArrives));
  const std::string once = synthetic.capture.folder + "/once", again = once + "-again";
  StreamSettings settings;
  settings.train = settings_of(800);
  settings.later_share = 0.75;
  settings.identity = "moved";
  const auto encode = [&](const std::string& folder, bool resume) {
    std::filesystem::create_directory(folder);
    std::vector<std::uint64_t> ended;
    std::unique_ptr<StreamEncoder> encoder;
    for (int begin = 0; begin < kFrames; begin += kWindow) {
      if (resume) encoder.reset();
      if (!encoder) {
        auto opened = StreamEncoder::open(folder, settings);
        INFO(opened.status().message());
        REQUIRE(opened.ok());
        encoder = std::move(*opened);
      }
      REQUIRE(encoder->frames() == begin);
      const auto window = encoder->encode(window_at(synthetic, begin), nullptr, nullptr);
      INFO(window.status().message());
      REQUIRE(window.ok());
      ended.push_back(window->ended);
    }
    REQUIRE(encoder->finish(folder + ".stgs").ok());
    return ended;
  };
  const std::vector<std::uint64_t> ended = encode(once, false);
  CHECK(ended[0] + ended[1] == 0);
  CHECK(ended[2] > 100);
  CHECK(encode(again, true) == ended);
  CHECK(testing::bytes_of(once + ".stgs") == testing::bytes_of(again + ".stgs"));

  const std::string file = once + ".stgs";
  const std::vector<double> at_old =
      test::psnr_by_frame(file, synthetic.capture, area_of(synthetic, kOld));
  const std::vector<double> at_new =
      test::psnr_by_frame(file, synthetic.capture, area_of(synthetic, kNew));
  const double box = mean_of(at_old, 0, kWindow);  // as good as the box can be
  CAPTURE(box, at_old, at_new);
  CHECK(mean_of(at_old, 3 * kWindow, kFrames) > box - 4);
  CHECK(mean_of(at_new, 3 * kWindow, kFrames) > box - 3);
  CHECK(mean_of(at_old, kArrives, 3 * kWindow) > 17);  // with the old box: 15.5 dB
}

TEST_CASE(
    "content that moves while images are smaller ends, and nothing ends by a change of size") {
  const SyntheticCapture synthetic(kCameras,
                                   test::box_move(kFrames, kOld, kNew, kLeaves, kArrives));
  StreamSettings settings;
  settings.train = settings_of(800);
  settings.later_share = 0.75;
  settings.resumable = false;
  settings.carries_moving = true;  // as live
  const PreparedCapture large = doubled(synthetic.capture);
  const std::string folder = synthetic.capture.folder + "/sizes", file = folder + ".stgs";
  std::filesystem::create_directory(folder);
  const auto encoder = StreamEncoder::open(folder, settings);
  REQUIRE(encoder.ok());
  std::vector<std::uint64_t> ended;
  for (const bool is_smaller : {false, true, true, false}) {
    const int begin = (*encoder)->frames();
    const auto window =
        extract_window(is_smaller ? synthetic.capture : large, {begin, begin + kWindow});
    REQUIRE(window.ok());
    const auto encoded = (*encoder)->encode(*window, nullptr, nullptr);
    INFO(encoded.status().message());
    REQUIRE(encoded.ok());
    CHECK(encoded->training.psnr > 20);
    ended.push_back(encoded->ended);
  }
  REQUIRE((*encoder)->finish(file).ok());
  CAPTURE(ended);
  CHECK(ended[0] + ended[1] == 0);
  CHECK(ended[2] > 100);
  CHECK(ended[3] < 40);

  const std::vector<double> all = test::psnr_by_frame(file, synthetic.capture);
  const std::vector<double> at_old =
      test::psnr_by_frame(file, synthetic.capture, area_of(synthetic, kOld));
  const std::vector<double> at_new =
      test::psnr_by_frame(file, synthetic.capture, area_of(synthetic, kNew));
  const double full = mean_of(all, 0, kWindow), box = mean_of(at_old, 0, kWindow);
  CAPTURE(full, box, all, at_old, at_new);
  CHECK(mean_of(all, kWindow, 2 * kWindow) > full - 1);
  CHECK(mean_of(all, 3 * kWindow, kFrames) > full - 3);
  CHECK(mean_of(at_old, 3 * kWindow, kFrames) > box - 5);
  CHECK(mean_of(at_new, 3 * kWindow, kFrames) > box - 4);
}
