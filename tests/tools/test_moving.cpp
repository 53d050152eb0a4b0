// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <set>

#include "catch.h"
#include "flicker.h"
#include "moving.h"

namespace stgs::tools {
namespace {

encoder::Image8 uniform_image(std::uint8_t value) {
  encoder::Image8 image;
  image.width = 8;
  image.height = 4;
  image.channels = 3;
  image.data.assign(8 * 4 * 3, value);
  return image;
}

}  // namespace

TEST_CASE("the median uses an odd number of evenly spread frames, or none") {
  for (std::size_t count : {0u, 1u, 4u}) CHECK(median_frames(count).empty());
  CHECK(median_frames(5) == std::vector<std::size_t>{0, 1, 2, 3, 4});
  CHECK(median_frames(6).size() == 5);
  for (std::size_t count : {15u, 16u, 17u, 300u}) {
    const std::vector<std::size_t> frames = median_frames(count);
    CAPTURE(count);
    REQUIRE(frames.size() == 15);
    CHECK(std::set<std::size_t>(frames.begin(), frames.end()).size() == 15);
    CHECK(frames.front() <= count / 15);
    CHECK(frames.back() >= count - 1 - count / 15);
    CHECK(frames.back() < count);
  }
}

TEST_CASE("the median ignores values that pass through a pixel briefly") {
  std::vector<encoder::Image8> images(5, uniform_image(90));
  for (std::size_t k = 0; k < 5; ++k) {
    images[k].data[3 * k] = 255;  // another pixel in each frame
    images[k].data[3 * (8 + k) + 2] = 0;
  }
  images[3].data[60] = images[1].data[60] = images[4].data[60] = 200;  // in most frames
  const encoder::Image8 median = median_of(images);
  for (std::size_t i = 0; i < median.data.size(); ++i) {
    CHECK(int{median.data[i]} == (i == 60 ? 200 : 90));
  }
}

TEST_CASE("the moving error covers all channels of the moving pixels only") {
  const encoder::Image8 background = uniform_image(100);
  encoder::Image8 ground_truth = background;
  ground_truth.data[3 * 5 + 1] = 121;  // above the threshold
  ground_truth.data[3 * 9] = 79;
  ground_truth.data[3 * 12 + 2] = 120;  // at the threshold
  Image image;
  image.reshape(8, 4, 3);
  for (float& v : image.data) v = 100.0f / 255.0f;
  image.plane(0)[20] = 1.0f;  // a large error at a static pixel
  ErrorSum sum = moving_error(image, ground_truth, background);
  CHECK(sum.pixels == 2);
  CHECK(sum.mean() == Approx(2 * 21.0 * 21.0 / (6 * 255.0 * 255.0)));
  sum += sum;
  CHECK(sum.pixels == 4);
  CHECK(sum.mean() == Approx(21.0 * 21.0 / (3 * 255.0 * 255.0)));
  CHECK(moving_error(image, background, background).pixels == 0);
}

TEST_CASE("flicker covers pixels that move in neither of two frames") {
  const encoder::Image8 background = uniform_image(100);
  encoder::Image8 before = background, now = background;
  before.data[3 * 2] = 200;  // moves in the first frame
  now.data[3 * 3 + 1] = 10;  // moves in the second
  now.data[3 * 7 + 2] = 110;
  Image render_before, render;
  for (Image* image : {&render_before, &render}) {
    image->reshape(8, 4, 3);
    for (float& v : image->data) v = 0.5f;
  }
  render.plane(0)[2] = render.plane(1)[3] = 1.0f;  // do not count
  render.plane(2)[9] = 0.5f + 30.0f / 255.0f;
  Flicker sum = flicker_of({render_before, render, before, now, background});
  CHECK(sum.pixels == 30);
  sum += sum;
  CHECK(sum.pixels == 60);
  CHECK(sum.json()["render"].get<double>() == Approx(std::sqrt(900.0 / 90)).epsilon(1e-5));
  CHECK(sum.json()["ground_truth"].get<double>() == Approx(std::sqrt(100.0 / 90)).epsilon(1e-5));
  CHECK(Flicker().json().is_null());
  CHECK(Flicker().text().empty());
}

}  // namespace stgs::tools
