// SPDX-License-Identifier: Apache-2.0
// The updates of refined cameras: single cameras are corrected, the rig as a whole is not.
#include <algorithm>
#include <cmath>
#include <limits>

#include "backend/backend.h"
#include "catch.h"
#include "train/camera_refinement.h"
#include "train/undo_lens.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

// Cameras on a circle of radius 4 around the centre of the scene, which they look at.
PreparedCapture ring(int cameras) {
  PreparedCapture capture;
  capture.scene_centre[2] = 1;
  for (int i = 0; i < cameras; ++i) {
    const double a = 2 * M_PI * i / cameras, c = std::cos(a), s = std::sin(a);
    Camera camera;
    camera.name = fmt::format("{}", i);
    camera.width = camera.height = 100;
    camera.fx = camera.fy = 100;
    camera.cx = camera.cy = 50;
    const double rotation[9] = {c, 0, -s, 0, 1, 0, s, 0, c};
    const double centre[3] = {-4 * s, 0, 1 - 4 * c};
    std::copy_n(rotation, 9, camera.rotation);
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < 3; ++k) camera.translation[r] -= rotation[3 * r + k] * centre[k];
    }
    capture.cameras.push_back(camera);
  }
  return capture;
}

// The gradient that pulls a camera upwards, in the world and in its image.
constexpr math::CameraGrad kUpwards = {{0, 0, 0}, {0, 1, 0}, 0, 0, 0};

math::Vec2 centre_of(int x, int y) {
  return {static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f};
}

double largest(const CameraCorrection& correction) {
  double out = 0;
  for (float v : correction) out = std::max(out, std::abs(double{v}));
  return out;
}

}  // namespace

TEST_CASE("a correction that all cameras share is undone, and that of a single one is kept") {
  const int count = GENERATE(3, 4, 5, 8);
  CAPTURE(count);
  const PreparedCapture capture = ring(count);
  TrainState all, one;
  begin_refinement(capture.cameras.size(), all);
  begin_refinement(capture.cameras.size(), one);
  for (int step = 0; step < 20; ++step) {
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      add_camera_gradient(all, c, kUpwards, 0);
      add_camera_gradient(one, c, c == 1 ? kUpwards : math::CameraGrad{}, 0);
    }
    update_cameras(capture, {1e-3f, 0.5f}, all);
    update_cameras(capture, {1e-3f, 0.5f}, one);
  }
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    CAPTURE(c);
    CHECK(largest(all.cameras[c]) < 1e-5);
    if (c == 1) CHECK(largest(one.cameras[c]) > 0.02);
    if (c != 1) CHECK(largest(one.cameras[c]) < 1e-6);
  }
}

TEST_CASE("the times of single cameras are corrected, within a frame, and no pose with them") {
  const PreparedCapture capture = ring(5);
  TrainState state, all;
  begin_refinement(capture.cameras.size(), state);
  begin_refinement(capture.cameras.size(), all);
  for (int step = 0; step < 50; ++step) {
    add_camera_gradient(state, 1, {{1, 1, 1}, {1, 1, 1}, 1, 1, -1}, 1);
    update_cameras(capture, {.time = 0.1f}, state);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c)
      add_camera_gradient(all, c, {{0, 0, 0}, {0, 0, 0}, 0, 0, -1}, 0);
    update_cameras(capture, {.time = 0.1f}, all);
  }
  CameraCorrection late{};
  late[kTimeShift] = kMaxTimeShift;
  CHECK(state.cameras[1] == late);
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    if (c != 1) CHECK(state.cameras[c] == CameraCorrection{});
    CHECK(largest(all.cameras[c]) < 1e-6);
  }
  CHECK(with_refined_cameras(capture, state).cameras[1].time_shift == kMaxTimeShift);
}

TEST_CASE("weak evidence moves no camera") {
  const PreparedCapture capture = ring(5);
  TrainState state;
  begin_refinement(capture.cameras.size(), state);
  for (int step = 0; step < 40; ++step) {
    const float sign = step % 2 == 0 ? 1.0f : -0.9f;
    add_camera_gradient(state, 2, {{0, 0, 0}, {0, sign, 0}, 0, 0, 0}, 0);
    update_cameras(capture, {1e-3f, 0.7f}, state);
  }
  CHECK(largest(state.cameras[2]) < 2e-3);
}

TEST_CASE("the lens of one camera is learnt, within limits, and one that all share is undone") {
  const PreparedCapture capture = ring(5);
  TrainState all, one;
  begin_refinement(capture.cameras.size(), all);
  begin_refinement(capture.cameras.size(), one);
  const math::CameraGrad bends = {{0, 0, 0}, {0, 0, 0}, 0, 1, 0};
  for (int step = 0; step < 1000; ++step) {
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      add_camera_gradient(all, c, bends, 1);
      add_camera_gradient(one, c, c == 1 ? bends : math::CameraGrad{}, c == 1 ? 1.0f : 0.0f);
    }
    update_cameras(capture, {3e-3f, 0.5f}, all);
    update_cameras(capture, {3e-3f, 0.5f}, one);
  }
  for (const CameraCorrection& camera : all.cameras) CHECK(largest(camera) < 1e-5);
  CHECK(lens_of(one.cameras[1]).distortion == -kMaxDistortion);
  CHECK(lens_of(one.cameras[1]).vignetting == -kMaxVignetting);
  CHECK(is_pinhole(lens_of(one.cameras[2])));
  const RefinedCamera refined = refined_cameras(capture, one)[1];
  CHECK(refined.pixels < 1e-3);
  CHECK(refined.corner_pixels == Approx(0.3 * 0.5 * 50 * M_SQRT2));
  CHECK(refined.corner_brightness == Approx(0.4));
}

TEST_CASE("an image without its lens is that of a pinhole") {
  const math::PinholeCamera camera = testing::scene_camera(160, 120);
  const math::Lens lens{0.08f, -0.3f};
  // Smooth content at positions of the pinhole.
  const auto content = [&camera](math::Vec2 p, int c) {
    return 128 + 90 * std::sin((0.05f + 0.01f * static_cast<float>(c)) * (p.x - camera.cx)) *
                     std::cos(0.06f * (p.y - camera.cy));
  };
  Image8 image{160, 120, 3, std::vector<std::uint8_t>(3 * 160 * 120)}, out;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) {
      const math::Vec2 seen = centre_of(x, y);
      math::Vec2 pixel = seen;  // whose image through the lens is `seen`
      for (int k = 0; k < 30; ++k) {
        const math::Vec2 at = math::through_lens(camera, lens, pixel);
        pixel = {pixel.x + seen.x - at.x, pixel.y + seen.y - at.y};
      }
      const float shade = 1 + lens.vignetting * math::lens_radius2(camera, seen);
      for (int c = 0; c < 3; ++c)
        image.data[3 * (160 * y + x) + c] =
            static_cast<std::uint8_t>(std::lround(shade * content(pixel, c)));
    }
  }
  undo_lens(image, camera, lens, out);
  double square = 0;
  int inside = 0;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) {
      const math::Vec2 pixel = centre_of(x, y);
      const math::Vec2 seen = math::through_lens(camera, lens, pixel);
      if (seen.x < 1 || seen.y < 1 || seen.x > 159 || seen.y > 119) continue;
      for (int c = 0; c < 3; ++c)
        square += std::pow(out.data[3 * (160 * y + x) + c] - content(pixel, c), 2);
      ++inside;
    }
  }
  CHECK(inside > 12000);
  CHECK(std::sqrt(square / (3 * inside)) < 1);
  undo_lens(image, camera, {0, 0}, out);
  CHECK(out.data == image.data);
}

TEST_CASE("the strongest lens with any principal point darkens no pixel") {
  math::PinholeCamera camera = testing::scene_camera(64, 48);
  camera.cx = GENERATE(-100.0f, 0.0f, 64.0f);
  const Image8 image{64, 48, 3, std::vector<std::uint8_t>(3 * 64 * 48, 100)};
  Image8 out;
  undo_lens(image, camera, {kMaxDistortion, -kMaxVignetting}, out);
  CHECK(*std::min_element(out.data.begin(), out.data.end()) >= 100);
  camera.cx = std::numeric_limits<float>::infinity();
  undo_lens(image, camera, {kMaxDistortion, -kMaxVignetting}, out);
  CHECK(out.data.size() == image.data.size());
}

TEST_CASE("the limits of the lens hold after a shared lens is undone") {
  const PreparedCapture capture = ring(5);
  TrainState state;
  begin_refinement(capture.cameras.size(), state);
  for (int step = 0; step < 60; ++step) {
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      const float sign = c < 2 ? -1.0f : 1.0f;
      add_camera_gradient(state, c, {{0, 0, 0}, {0, 0, 0}, 0, sign, 0}, sign);
    }
    update_cameras(capture, {0.1f, 0}, state);
  }
  for (const CameraCorrection& camera : state.cameras) {
    CHECK(std::abs(camera[kDistortion]) <= kMaxDistortion);
    CHECK(std::abs(camera[kVignetting]) <= kMaxVignetting);
  }
}

TEST_CASE("the gradients of the lens are the slopes of the loss") {
  const int width = 160, height = 96;
  const math::PinholeCamera camera = testing::scene_camera(width, height);
  TrainState before =
      testing::train_state(testing::random_scene(3000, camera, 5, testing::SceneShape{}), 3);
  for (ColourMap& map : before.colour) map = kIdentityColour;
  for (float& v : before.set.sh) v *= 0.2f;  // colours within [0, 1]
  SplatFrame frame;
  RasterOutput output;
  render(before.set, 9.0, camera, RasterSettings{}, frame, output);
  Image8 rendered{width, height, 3, std::vector<std::uint8_t>(3 * width * height)}, ground_truth;
  for (std::size_t i = 0; i < rendered.data.size(); ++i) {
    const float value = output.colour.plane(static_cast<int>(i % 3))[i / 3];
    rendered.data[i] = static_cast<std::uint8_t>(255 * std::clamp(value, 0.0f, 1.0f) + 0.5f);
  }
  const auto backend = make_cpu_backend();
  const auto step = [&](float weight_l1, math::Lens lens) {
    TrainState state = before;
    StepInput input = testing::train_step(camera, ground_truth, 9.0f, 3);
    input.background = {0, 0, 0};
    input.drop_share = 0;
    input.weight_lifespan = input.weight_opacity = input.weight_scale = 0;
    input.weight_l1 = weight_l1;
    input.weight_ssim = 1 - weight_l1;
    input.gather_camera = true;
    input.lens = lens;
    TrainPlan plan;
    plan.primitives = state.size();
    plan.sh_coefficients = 16;
    plan.width = width;
    plan.height = height;
    REQUIRE(backend->reserve(plan).ok());
    REQUIRE(backend->begin(state).ok());
    REQUIRE(backend->step(input).ok());
    const auto outputs = backend->read();
    REQUIRE(outputs.ok());
    return outputs->front();
  };
  // SSIM, which is smooth, for the distortion, and L1, which sees brightness, for the vignetting. A
  // ground truth with the lens undone looks as if taken with the opposite one.
  constexpr float k = 0.02f, v = 0.05f;
  undo_lens(rendered, camera, {k, 0}, ground_truth);
  const double by_distortion = (step(0, {k, 0}).loss - step(0, {-k, 0}).loss) / (2 * k);
  CHECK(std::abs(by_distortion) > 1e-3);
  CHECK(step(0, {0, 0}).camera.value().distortion == Approx(by_distortion).epsilon(0.3));
  undo_lens(rendered, camera, {0, 2 * v}, ground_truth);
  const double by_vignetting = (step(1, {0, v}).loss - step(1, {0, -v}).loss) / (2 * v);
  CHECK(std::abs(by_vignetting) > 1e-3);
  CHECK(step(1, {0, 0}).vignetting == Approx(by_vignetting).epsilon(0.2));
}
