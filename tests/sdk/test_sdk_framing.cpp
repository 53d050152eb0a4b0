// SPDX-License-Identifier: Apache-2.0
// Views that frame an entire scene, for files without a start camera.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "sdk_fixture.h"

namespace stgs::testing {
namespace {

std::vector<std::uint8_t> file_of(Scene scene) {
  auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  return std::move(bytes).value();
}

// Opaque static primitives. The random scene is scaled by `scale` and moved by `offset` on each
// axis.
Scene scaled_scene(std::size_t count, float scale, float offset = 0) {
  Scene scene = random_scene(count, 0, 30, 5);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.position.size(); ++i) {
    set.position[i] = scale * set.position[i] + offset;
    set.log_scale[i] = std::log(0.15f * scale);
  }
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 5.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1000.0f);
  return scene;
}

stgs_view default_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, 160, 90) == STGS_OK);
  return view;
}

stgs_view framed(const ScenePtr& scene, stgs_view view) {
  REQUIRE(stgs_scene_frame_view(scene.get(), &view) == STGS_OK);
  return view;
}

// The extent of the projected positions as a share of the image's width and height, and the share
// of pixels that are covered.
struct Coverage {
  double width = 0, height = 0, pixels = 0;
};
// Checks that every position lies in front of the near plane and within the image.
Coverage check_coverage(const Scene& source, const ScenePtr& scene, const stgs_view& view) {
  double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
  for (std::size_t i = 0; i < source.gaussians.size(); ++i) {
    double p[3];
    for (int row = 0; row < 3; ++row) {
      p[row] = view.translation[row];
      for (int k = 0; k < 3; ++k) {
        p[row] += double{view.rotation[3 * row + k]} * source.gaussians.position[3 * i + k];
      }
    }
    CHECK(p[2] > view.near_plane);
    const double pixel[2] = {view.fx * p[0] / p[2] + view.cx, view.fy * p[1] / p[2] + view.cy};
    for (int k = 0; k < 2; ++k) {
      low[k] = std::min(low[k], pixel[k]);
      high[k] = std::max(high[k], pixel[k]);
    }
  }
  CHECK(std::min(low[0], low[1]) > 0);
  CHECK(high[0] < view.width);
  CHECK(high[1] < view.height);
  const auto pixels = render_rgba8(cpu_renderer().get(), scene.get(), 0.5, view);
  std::size_t covered = 0;
  for (std::size_t i = 3; i < pixels.size(); i += 4) covered += pixels[i] > 127 ? 1 : 0;
  return {(high[0] - low[0]) / view.width, (high[1] - low[1]) / view.height,
          4.0 * static_cast<double>(covered) / static_cast<double>(pixels.size())};
}

// Turned 40 degrees to the right and rolled by 90 degrees.
stgs_view turned_view() {
  stgs_view view = default_view();
  const float c = std::cos(0.7f), s = std::sin(0.7f);
  const float rows[9] = {0, 1, 0, -c, 0, s, s, 0, c};
  std::copy_n(rows, 9, view.rotation);
  return view;
}

}  // namespace

TEST_CASE("framing moves a view to show the entire scene", "[sdk]") {
  const Scene source = scaled_scene(300, 1);
  const auto file = file_of(source);
  const ScenePtr scene = open_scene(file);
  stgs_view view = default_view();
  view.background[1] = 0.5f;
  view.fovea_x = 3;
  SECTION("default view") {}
  SECTION("turned") {
    view = turned_view();
  }
  SECTION("portrait format") {
    REQUIRE(stgs_view_resize(&view, 40, 200) == STGS_OK);
  }
  SECTION("long focal length") {
    view.fx = view.fy = 900;
  }
  SECTION("principal point outside the image") {
    view.cx = -100, view.cy = 80;
  }
  SECTION("distant initial position") {
    view.translation[0] = -50, view.translation[2] = 1e6f;
  }
  const stgs_view placed = framed(scene, view);
  const Coverage coverage = check_coverage(source, scene, placed);
  CHECK(std::max(coverage.width, coverage.height) > 0.4);  // not unnecessarily far away
  CHECK(coverage.pixels > 0.08);
  // Only the translation changes.
  stgs_view same = placed;
  std::copy_n(view.translation, 3, same.translation);
  CHECK(std::memcmp(&same, &view, sizeof view) == 0);
}

TEST_CASE("framing works for scenes of any scale and position", "[sdk]") {
  struct Case {
    float scale, offset;
  };
  for (const Case& one : {Case{1e-6f, 0}, Case{1e-3f, 0}, Case{1e3f, 0}, Case{1e12f, 0},
                          Case{1, 1e4f}, Case{1, -3e4f}}) {
    INFO("scale " << one.scale << ", offset " << one.offset);
    const Scene source = scaled_scene(300, one.scale, one.offset);
    const auto file = file_of(source);
    const ScenePtr scene = open_scene(file);
    const stgs_view view = framed(scene, default_view());
    CHECK(view.near_plane <= default_view().near_plane);
    CHECK(check_coverage(source, scene, view).pixels > 0.08);
  }
}

TEST_CASE("framing works for planes, lines and a point", "[sdk]") {
  for (const int axes : {0, 1, 2, 4, 3, 5, 6}) {  // bit k: the scene has an extent along axis k
    INFO(axes);
    Scene source = scaled_scene(axes == 0 ? 1 : 100, 1);
    for (std::size_t i = 0; i < source.gaussians.position.size(); ++i) {
      if ((axes >> i % 3 & 1) == 0) source.gaussians.position[i] = 0.7f;
    }
    const auto file = file_of(source);
    const ScenePtr scene = open_scene(file);
    CHECK(check_coverage(source, scene, framed(scene, default_view())).pixels > 0.01);
  }
}

TEST_CASE("framing does not move farther away for a scene far from the origin", "[sdk]") {
  Scene source = scaled_scene(100, 1);
  const auto near = file_of(source);
  const stgs_view expected = framed(open_scene(near), default_view());
  for (std::size_t i = 0; i < source.gaussians.position.size(); i += 3) {
    source.gaussians.position[i] += 1e6f;
  }
  const auto far = file_of(source);
  const stgs_view view = framed(open_scene(far), default_view());
  CHECK(view.translation[2] == Approx(expected.translation[2]).epsilon(0.2));
}

TEST_CASE("framing an empty scene shows a metre around the origin", "[sdk]") {
  Scene source = scaled_scene(0, 1);
  for (const float metres_per_unit : {0.0f, 0.01f}) {
    source.metadata.metres_per_unit = metres_per_unit;
    const auto file = file_of(source);
    const stgs_view view = framed(open_scene(file), default_view());
    const float metre = metres_per_unit > 0 ? 1 / metres_per_unit : 1;
    CHECK(view.translation[0] == 0);
    CHECK(view.translation[1] == 0);
    CHECK(view.translation[2] > 0.5f * metre);
    CHECK(view.translation[2] < 3 * metre);
  }
}

TEST_CASE("without a start camera, the default view is level", "[sdk]") {
  Scene source = scaled_scene(100, 1);
  source.metadata.near_plane = 0;  // valid in a file, invalid in a view
  const float tilted[3] = {0.36f, -0.48f, 0.8f}, down[3] = {0, -1, 0}, z[3] = {0, 0, 1};
  for (const float* up : {tilted, down, z}) {
    std::copy_n(up, 3, source.metadata.up);
    const auto file = file_of(source);
    const ScenePtr scene = open_scene(file);
    stgs_view view{};
    view.struct_size = sizeof view;
    REQUIRE(stgs_scene_start_view(scene.get(), &view) == STGS_ERROR_UNSUPPORTED);
    CHECK(view.near_plane > 0);
    for (int i = 0; i < 3; ++i) CHECK(view.rotation[3 + i] == Approx(-up[i]).margin(1e-6));
    // The view looks along z unless z is up.
    CHECK(view.rotation[up == z ? 7 : 8] > 0.5f);
    CHECK(check_coverage(source, scene, framed(scene, view)).pixels > 0.08);
  }
  const auto plain = file_of(scaled_scene(100, 1));
  stgs_view view{};
  view.struct_size = sizeof view;
  REQUIRE(stgs_scene_start_view(open_scene(plain).get(), &view) == STGS_ERROR_UNSUPPORTED);
  CHECK(std::memcmp(view.rotation, default_view().rotation, sizeof view.rotation) == 0);
}

TEST_CASE("a view that cannot be framed is rejected and unchanged", "[sdk]") {
  const auto file = file_of(scaled_scene(10, 1));
  const ScenePtr scene = open_scene(file);
  const stgs_view good = default_view();
  CHECK(stgs_scene_frame_view(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_scene_frame_view(scene.get(), nullptr) == STGS_ERROR_ARGUMENT);
  stgs_view view = good;
  CHECK(stgs_scene_frame_view(make_scene().get(), &view) == STGS_ERROR_STATE);
  view.struct_size = 3;
  CHECK(stgs_scene_frame_view(scene.get(), &view) == STGS_ERROR_STRUCT_SIZE);

  const auto check_rejected = [&](const ScenePtr& target, stgs_view before, stgs_result result,
                                  const char* message) {
    stgs_view after = before;
    CHECK(stgs_scene_frame_view(target.get(), &after) == result);
    CHECK(std::memcmp(&after, &before, sizeof before) == 0);
    INFO(error_of(target.get()).message);
    CHECK(std::string(error_of(target.get()).message).find(message) != std::string::npos);
  };
  view = good;
  view.fy = 0;
  check_rejected(scene, view, STGS_ERROR_ARGUMENT, "fy 0");
  view = good;
  view.rotation[0] = NAN;
  check_rejected(scene, view, STGS_ERROR_ARGUMENT, "rotation");
  view = good;
  view.width = 0;
  check_rejected(scene, view, STGS_ERROR_ARGUMENT, "0x90 pixels");

  Scene wide = scaled_scene(2, 1);
  wide.gaussians.position[0] = 3e38f;
  wide.gaussians.position[3] = -3e38f;
  const auto far = file_of(wide);
  check_rejected(open_scene(far), good, STGS_ERROR_UNSUPPORTED, "units away");
  // A single distant point is rejected too.
  Scene lonely = scaled_scene(1, 1);
  lonely.gaussians.position[1] = 1e30f;
  const auto lone = file_of(lonely);
  check_rejected(open_scene(lone), good, STGS_ERROR_UNSUPPORTED, "units away");
}

}  // namespace stgs::testing
