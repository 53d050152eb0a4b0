// SPDX-License-Identifier: Apache-2.0
#include <numeric>

#include "fixtures/scene_fixture.h"
#include "fourdgs_reading.h"
#include "interchange/lifespan_fit.h"

using namespace stgs;
using namespace stgs::testing::fourdgs;
using Catch::Contains;

namespace {

std::string write(const Scene& scene, ConversionNotes* notes = nullptr,
                  std::vector<std::uint32_t>* order = nullptr) {
  const auto bytes = write_4dgs(scene, notes, order);
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  return {bytes->begin(), bytes->end()};
}

// The squared difference of a flat top and a Gaussian, summed over small steps.
double squared_difference(double fitted, double sigma, double radius) {
  double sum = 0;
  for (double t = 0.005; t < 5 * (sigma + radius); t += 0.01) {
    const double beyond = std::max(0.0, t - radius) / sigma, x = t / fitted;
    const double d = std::exp(-beyond * beyond) - std::exp(-x * x);
    sum += d * d;
  }
  return sum;
}

}  // namespace

TEST_CASE("4dgs: the Gaussian of a flat top has the least squared error") {
  CHECK(fitted_sigma(3, 0) == Approx(3));
  for (const double radius : {0.3, 1.0, 2.5, 6.0, 20.0}) {
    const double best = fitted_sigma(2, radius);
    const double error = squared_difference(best, 2, radius);
    for (const double factor : {0.95, 0.99, 1.01, 1.05}) {
      INFO(radius << " " << factor);
      CHECK(error < squared_difference(factor * best, 2, radius));
    }
  }
}

TEST_CASE("4dgs: a lifespan becomes the better one of a fade and hard edges") {
  const TickRange clip = {0, 100};
  const LifespanFit fade = fit_lifespan(50, 4, 1, clip);
  CHECK_FALSE(fade.never_fades);
  CHECK(fade.error_max < 0.1);
  const LifespanFit edges = fit_lifespan(50, 0.5, 10, clip);
  CHECK(edges.never_fades);
  CHECK(edges.begin == 39.5);
  CHECK(edges.end == 60.5);
  // A flat top over the complete clip, or up to its end.
  const LifespanFit whole = fit_lifespan(50, 1, 100, clip);
  CHECK(whole.never_fades);
  CHECK(whole.begin == 0);
  CHECK(whole.end == 100);
  CHECK(whole.error_max == 0);
  const LifespanFit late = fit_lifespan(120, 0.5, 60, clip);
  CHECK(late.begin == 59.5);
  CHECK(late.end == 100);
  // An exact fade.
  const LifespanFit exact = fit_lifespan(30, 7, 0, clip);
  CHECK_FALSE(exact.never_fades);
  CHECK(exact.sigma == 7);
  CHECK(exact.error_max < 1e-12);
}

TEST_CASE("4dgs: what is written is read back within the declared bounds") {
  for (const int degree : {0, 1, 3}) {
    Scene scene = stgs::testing::random_scene(3000, degree, 90, 7);
    scene.metadata.time_base = {1001, 30000};
    Gaussians4D& set = scene.gaussians;
    std::fill(set.radius.begin(), set.radius.end(), 0.0f);  // fades only: exact but for rounding
    ConversionNotes notes;
    std::vector<std::uint32_t> order;
    const std::string bytes = write(scene, &notes, &order);
    const Scene back = read_valid(bytes, &notes);
    CHECK(back.metadata.time_base == scene.metadata.time_base);
    CHECK(back.metadata.frames == 90);
    CHECK(back.metadata.title == scene.metadata.title);
    REQUIRE(back.gaussians.size() == order.size());
    const auto errors = conversion_errors(set.gather(order), back);
    REQUIRE(errors.ok());
    std::vector<float> sizes;
    for (std::size_t i = 0; i < set.size(); ++i) {
      std::array<float, 3> s = {set.log_scale[3 * i], set.log_scale[3 * i + 1],
                                set.log_scale[3 * i + 2]};
      std::sort(s.begin(), s.end());
      sizes.push_back(std::exp(s[1]));
    }
    std::sort(sizes.begin(), sizes.end());
    // Position and velocity are each wrong by a fiftieth of a small size in each axis.
    CHECK(errors->position_max < 0.02 * sizes[sizes.size() / 4] * 2 * std::sqrt(3.0) * 1.1);
    CHECK(errors->log_scale_max < 0.005);
    CHECK(errors->rotation_max < 0.2);
    CHECK(errors->opacity_max < 0.51 / 255);
    CHECK(errors->visibility_max < 0.015);
    CHECK(errors->sh_max < 0.0158);
    CHECK_FALSE(has_note(notes, "lifespans"));
    // Omitted primitives are invisible.
    std::sort(order.begin(), order.end());
    CHECK(std::adjacent_find(order.begin(), order.end()) == order.end());
    CHECK(order.size() > 2700);
  }
}

TEST_CASE("4dgs: static primitives stay static") {
  Scene scene = stgs::testing::random_scene(100, 1, 30, 3);
  set_static_lifespan(scene.gaussians, 30);
  ConversionNotes notes;
  const Scene back = read_valid(write(scene, &notes));
  REQUIRE(back.gaussians.size() > 80);
  for (std::size_t i = 0; i < back.gaussians.size(); ++i) {
    CHECK(back.gaussians.time[i] == 15);
    CHECK(back.gaussians.radius[i] == 30);
    CHECK(back.gaussians.velocity[3 * i] == 0);
  }
  CHECK_FALSE(has_note(notes, "lifespans"));
}

TEST_CASE("4dgs: approximations and clipped values are reported in numbers") {
  Scene scene = stgs::testing::random_scene(3, 1, 30, 3);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 3.0f);
  set.time = {15, 15, 15};
  set.sigma = {4, 0.25f, 100};
  set.radius = {1, 5, 0};
  std::fill(set.sh.begin(), set.sh.end(), 0.0f);
  set.sh[0] = 2.5f;   // 1.205
  set.sh[1] = -2.0f;  // -0.064
  set.sh[5] = 4.5f;
  ConversionNotes notes;
  const std::string bytes = write(scene, &notes);
  CHECK(has_note(notes,
                 "approximated the lifespans of 1 of 3 primitives by a Gaussian and of 1 by "
                 "hard edges: visibility differs by up to "));
  CHECK(has_note(notes, "clipped 2 of 9 colours to the range from 0 to 1, by up to 0.21"));
  CHECK(has_note(notes, "clipped 1 of 27 SH coefficients to the range from -4 to 4, by up to 0.5"));
  set.position[0] = 1e30f;
  set.position[4] = -1e30f;
  CHECK(write_4dgs(scene).ok());  // with coarser positions
  set.sh[0] = NAN;
  CHECK(write_4dgs(scene).status().code() == StatusCode::kUsage);
  set.sh[0] = 0;
  scene.metadata.frames = 0;
  CHECK(write_4dgs(scene).status().code() == StatusCode::kUsage);
}

TEST_CASE("4dgs: parts become windows and windows parts") {
  Scene scene = stgs::testing::random_scene(400, 0, 60, 5);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.radius.begin(), set.radius.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 20.0f);
  for (std::size_t i = 0; i < 400; ++i) set.time[i] = static_cast<float>(i % 20);
  scene.parts = {{0, 20, 100}, {20, 40, 200}, {40, 60, 100}};
  const Scene back = read_valid(write(scene));
  for (const double ticks : {0.0, 19.0, 20.0, 35.0, 40.0, 59.0}) {
    const auto expected = snapshot_at(scene, ticks), actual = snapshot_at(back, ticks);
    REQUIRE(expected.ok());
    CHECK(std::abs(static_cast<double>(expected->size()) - static_cast<double>(actual->size())) <
          3);  // of primitives that are barely visible
    const auto sum = [](const Gaussians4D& s) {
      double total = 0;
      for (std::size_t i = 0; i < s.size(); ++i) total += opacity(s, i);
      return total;
    };
    CHECK(sum(*actual) == Approx(sum(*expected)).epsilon(0.01));
  }
}

TEST_CASE("4dgs: chunks have the intervals of their primitives, and the index describes them") {
  Scene scene = stgs::testing::random_scene(20'000, 0, 300, 5);
  const std::string bytes = write(scene);
  // The reader compares the index with the chunks, and its checksum.
  ConversionNotes notes;
  const Scene back = read_valid(bytes, &notes);
  CHECK_FALSE(has_note(notes, "checksum"));
  std::string damaged = bytes;
  damaged[damaged.size() - 60] = static_cast<char>(damaged[damaged.size() - 60] ^ 1);
  notes.clear();
  const auto other = read(damaged, &notes);
  CHECK((!other.ok() || has_note(notes, "checksum")));
  Scene none;
  none.metadata.frames = 1;
  CHECK(read_valid(write(none)).gaussians.size() == 0);
}

TEST_CASE("4dgs: the start camera survives") {
  Scene scene = stgs::testing::random_scene(10, 0, 10, 5);
  StartCamera camera;
  camera.rotation[0] = camera.rotation[8] = 0.6f;
  camera.rotation[2] = -0.8f;
  camera.rotation[6] = 0.8f;
  camera.translation[0] = 1;
  camera.translation[1] = -2;
  camera.translation[2] = 3;
  camera.width = 640;
  camera.height = 720;
  camera.fx = camera.fy = 500;
  scene.metadata.start_camera = camera;
  const Scene back = read_valid(write(scene));
  REQUIRE(back.metadata.start_camera);
  for (int i = 0; i < 9; ++i) {
    CHECK(back.metadata.start_camera->rotation[i] == Approx(camera.rotation[i]).margin(1e-5));
  }
  for (int i = 0; i < 3; ++i) {
    CHECK(back.metadata.start_camera->translation[i] == Approx(camera.translation[i]).margin(1e-5));
  }
  CHECK(back.metadata.start_camera->fy == Approx(500));
}
