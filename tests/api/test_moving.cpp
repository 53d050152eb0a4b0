// SPDX-License-Identifier: Apache-2.0
#include <set>

#include "catch.h"
#include "moving.h"

namespace stgs::tools {
namespace {

encoder::Image8 plain(std::uint8_t value) {
  encoder::Image8 picture;
  picture.width = 8;
  picture.height = 4;
  picture.channels = 3;
  picture.data.assign(8 * 4 * 3, value);
  return picture;
}

}  // namespace

TEST_CASE("the median is of an odd number of frames spread over all, or of none") {
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

TEST_CASE("the median does not see what passes by") {
  std::vector<encoder::Image8> pictures(5, plain(90));
  for (std::size_t k = 0; k < 5; ++k) {
    pictures[k].data[3 * k] = 255;  // one pixel after the other
    pictures[k].data[3 * (8 + k) + 2] = 0;
  }
  pictures[3].data[60] = pictures[1].data[60] = pictures[4].data[60] = 200;  // most of the time
  const encoder::Image8 median = median_of(pictures);
  for (std::size_t i = 0; i < median.data.size(); ++i) {
    CHECK(int{median.data[i]} == (i == 60 ? 200 : 90));
  }
}

TEST_CASE("the error within what moves counts the moving pixels alone, in every channel") {
  const encoder::Image8 background = plain(100);
  encoder::Image8 truth = background;
  truth.data[3 * 5 + 1] = 121;  // beyond the threshold
  truth.data[3 * 9] = 79;
  truth.data[3 * 12 + 2] = 120;  // at the threshold
  Image picture;
  picture.reshape(8, 4, 3);
  for (float& v : picture.data) v = 100.0f / 255.0f;
  picture.plane(0)[20] = 1.0f;  // a bad error where nothing moves
  ErrorSum sum = moving_error(picture, truth, background);
  CHECK(sum.pixels == 2);
  CHECK(sum.mean() == Approx(2 * 21.0 * 21.0 / (6 * 255.0 * 255.0)));
  sum += sum;
  CHECK(sum.pixels == 4);
  CHECK(sum.mean() == Approx(21.0 * 21.0 / (3 * 255.0 * 255.0)));
  CHECK(moving_error(picture, background, background).pixels == 0);
}

}  // namespace stgs::tools
