// SPDX-License-Identifier: Apache-2.0
// Training on the content inside the masks.
#include <algorithm>
#include <random>
#include <set>

#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"
#include "stgs/format/raster.h"
#include "train/colour_correction.h"
#include "train/colour_inverse.h"
#include "train/foreground.h"
#include "train/train_state.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::moving_alpha;
using stgs::test::run;
using stgs::test::short_run;
using stgs::test::SyntheticCapture;
using stgs::test::write_masks;

TEST_CASE("a colour map is undone by its inverse, and a singular one changes nothing") {
  const ColourMap map = {0.9f, 0.05f,  -0.1f, 0.02f, 1.1f,  0.04f,
                         0.0f, -0.03f, 0.95f, 0.1f,  -0.2f, 0.05f};
  const math::Vec3 x{0.2f, 0.6f, 0.9f};
  const math::Vec3 shown{map[0] * x.x + map[1] * x.y + map[2] * x.z + map[9],
                         map[3] * x.x + map[4] * x.y + map[5] * x.z + map[10],
                         map[6] * x.x + map[7] * x.y + map[8] * x.z + map[11]};
  const math::Vec3 back = before_colour_map(map.data(), shown);
  CHECK(back.x == Approx(x.x).margin(1e-5));
  CHECK(back.y == Approx(x.y).margin(1e-5));
  CHECK(back.z == Approx(x.z).margin(1e-5));
  const ColourMap singular{};
  CHECK(before_colour_map(singular.data(), x).y == x.y);
}

TEST_CASE("the gradient of a colour map does not depend on a background that it does not act on") {
  const math::Vec3 shown{0.9f, 0.1f, 0.4f};
  Image own, transmittance, weights;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (auto& [image, channels] : {std::pair{&own, 3}, {&transmittance, 1}, {&weights, 3}}) {
    image->reshape(9, 7, channels);
    for (float& x : image->data) x = uniform(random);
  }
  // The rendered image, whose background becomes `shown` after the map.
  const auto rendered = [&](const ColourMap& map) {
    const math::Vec3 behind = before_colour_map(map.data(), shown);
    Image image = own;
    for (std::size_t i = 0; i < transmittance.data.size(); ++i) {
      image.plane(0)[i] += transmittance.data[i] * behind.x;
      image.plane(1)[i] += transmittance.data[i] * behind.y;
      image.plane(2)[i] += transmittance.data[i] * behind.z;
    }
    return image;
  };
  const auto loss = [&](const ColourMap& map) {
    Image corrected;
    apply_colour(map, rendered(map), corrected);
    double sum = 0;
    for (std::size_t i = 0; i < corrected.data.size(); ++i)
      sum += double{weights.data[i]} * corrected.data[i];
    return sum;
  };
  const ColourMap map = {0.9f, 0.05f,  -0.1f, 0.02f, 1.1f,  0.04f,
                         0.0f, -0.03f, 0.95f, 0.1f,  -0.2f, 0.05f};
  Image d_corrected = weights;
  const UnmappedBackground unmapped{transmittance, before_colour_map(map.data(), shown)};
  const ColourMap gradient = colour_backward(map, rendered(map), d_corrected, &unmapped);
  for (std::size_t k = 0; k < map.size(); ++k) {
    ColourMap high = map, low = map;
    high[k] += 1e-2f;
    low[k] -= 1e-2f;
    CHECK(gradient[k] == Approx((loss(high) - loss(low)) / (high[k] - low[k])).epsilon(2e-3));
  }
}

TEST_CASE("the colour outside the masks differs between views") {
  std::set<std::array<std::uint8_t, 3>> colours;
  for (std::size_t view = 0; view < 100; ++view) {
    colours.insert(mask_colour_of(view));
    const math::Vec3 colour = mask_background_of(view);
    CHECK(colour.x * 255 == Approx(mask_colour_of(view)[0]).margin(1e-3));
  }
  CHECK(colours.size() == 100);
}

TEST_CASE("only the foreground is trained, with its alpha") {
  const SyntheticCapture synthetic;
  write_masks(synthetic);
  TrainSettings settings = short_run(900);
  settings.foreground = true;
  TrainReport report;
  const auto trained = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(trained.ok());
  const SceneMetadata& metadata = trained->metadata;
  CHECK(*std::max_element(metadata.background, metadata.background + 3) == 0);
  REQUIRE(report.held_out);
  CHECK(report.held_out->psnr > 24);
  const Camera& held_out = synthetic.capture.cameras.front();
  SplatFrame splats;
  RasterOutput output;
  RasterSettings rendering;
  rendering.kernel = metadata.kernel;
  double inside = 0, outside = 0, pixels = 0, rest = 0;
  for (int frame = 0; frame < synthetic.capture.frames; ++frame) {
    const std::vector<float> expected = moving_alpha(synthetic, held_out, frame).data;
    render(trained->gaussians, static_cast<float>(frame), held_out.pinhole(0.3f), rendering, splats,
           output);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (expected[i] > 0.9f) {
        inside += output.alpha.data[i];
        ++pixels;
      } else if (expected[i] < 0.05f) {
        outside += output.alpha.data[i];
        ++rest;
      }
    }
  }
  CAPTURE(inside / pixels, outside / rest, pixels, rest);
  CHECK(inside / pixels > 0.85);
  CHECK(outside / rest < 0.02);
}

TEST_CASE("static points outside the masks are not used, and a missing mask is an error") {
  const SyntheticCapture synthetic;
  PreparedCapture capture = synthetic.capture;
  capture.mask_background = kMaskBackground;
  write_masks(synthetic, capture.cameras[2].name);
  auto points = read_points(capture.folder + "/points_static.ply");
  REQUIRE(points.ok());
  const Status missing = keep_foreground(capture, *points);
  CHECK(missing.code() == StatusCode::kInvalidFile);
  CHECK(missing.message().find("has no mask") != std::string::npos);
  TrainSettings settings = short_run(2);
  settings.foreground = true;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kInvalidFile);

  write_masks(synthetic);
  const std::size_t before = points->size();
  REQUIRE(keep_foreground(capture, *points).ok());
  CHECK(points->size() < before / 4);
}
