// SPDX-License-Identifier: Apache-2.0
#include <set>

#include "catch.h"
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

}  // namespace stgs::tools
