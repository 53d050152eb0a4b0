// SPDX-License-Identifier: Apache-2.0
// The background of a live camera: content in front of it is masked until it has come to rest.
#include "init/background.h"

#include <opencv2/imgproc.hpp>

#include "catch.h"
#include "init/point_frames.h"

using namespace stgs::encoder::init;

namespace {

constexpr int kWindow = 15, kRestFrames = 60;
const cv::Rect kPlace(40, 30, 20, 20);
const cv::Point kInside(50, 40), kOutside(10, 10);

cv::Mat wall() {
  cv::Mat image(80, 100, CV_8UC3, cv::Scalar(90, 100, 110));
  for (int x = 0; x < 100; x += 10) cv::line(image, {x, 0}, {x, 79}, {120, 110, 100});
  return image;
}

// The wall with a box in front of it.
cv::Mat with_box(cv::Rect place) {
  cv::Mat image = wall();
  image(place).setTo(cv::Scalar(220, 40, 30));
  return image;
}

LiveBackground of_wall() {
  const cv::Mat image = wall();
  return {{image.clone(), cv::Mat(image.size(), CV_8U, cv::Scalar(255)), 1.0}, kRestFrames};
}

// A window whose frames are these.
void see(LiveBackground& background, const std::vector<cv::Mat>& images) {
  cv::Mat masked(images[0].size(), CV_8U, cv::Scalar(0));
  for (const cv::Mat& image : images) masked |= background.mask(image);
  background.learn(images, masked, kWindow);
}

}  // namespace

TEST_CASE("a live background masks content in front of it, until it has been at rest for long") {
  LiveBackground background = of_wall();
  CHECK(cv::countNonZero(background.mask(wall())) == 0);
  const cv::Mat box = with_box(kPlace);
  const cv::Mat mask = background.mask(box);
  CHECK(mask.at<std::uint8_t>(kInside) == 255);
  CHECK(mask.at<std::uint8_t>(kOutside) == 0);
  CHECK(share_of(mask) > 0.04);
  CHECK(share_of(mask) < 0.1);
  for (int frames = 0; frames < kRestFrames; frames += kWindow) {
    CHECK(background.mask(box).at<std::uint8_t>(kInside) == 255);
    see(background, {box, box, box});
  }
  CHECK(background.mask(box).at<std::uint8_t>(kInside) == 0);
  // Now the wall behind it differs.
  CHECK(background.mask(wall()).at<std::uint8_t>(kInside) == 255);
}

TEST_CASE("content that moves never becomes background") {
  LiveBackground background = of_wall();
  for (int window = 0; window < 10; ++window) {
    const int x = 7 * window;  // covers a pixel for three windows
    see(background,
        {with_box({x, 30, 20, 20}), with_box({x + 1, 30, 20, 20}), with_box({x + 2, 30, 20, 20})});
  }
  CHECK(cv::countNonZero(background.mask(wall())) == 0);
}

TEST_CASE("a place is still once nothing but background was there for long") {
  LiveBackground background = of_wall();
  const cv::Mat image = wall();
  for (int frames = 0; frames < kRestFrames; frames += kWindow) {
    CHECK(cv::countNonZero(background.still()) == 0);
    see(background, {image, image, image});
  }
  CHECK(cv::countNonZero(background.still()) == 80 * 100);
  // Something passes in a frame that is not among those that it learns from.
  background.learn({image, image, image}, background.mask(with_box(kPlace)), kWindow);
  CHECK(background.still().at<std::uint8_t>(kInside) == 0);
  CHECK(background.still().at<std::uint8_t>(kOutside) == 255);
}

TEST_CASE("a live background follows the light") {
  LiveBackground background = of_wall();
  for (int window = 1; window <= 40; ++window) {
    const cv::Mat brighter = wall() + cv::Scalar::all(window);
    CHECK(cv::countNonZero(background.mask(brighter)) == 0);
    see(background, {brighter, brighter, brighter});
  }
}

TEST_CASE("every n-th frame has points, in the middle of those that it stands for") {
  CHECK(point_frames(5, 1) == std::vector<int>{0, 1, 2, 3, 4});
  CHECK(point_frames(15, 5) == std::vector<int>{2, 7, 12});
  CHECK(point_frames(15, 4) == std::vector<int>{2, 6, 10, 14});
  CHECK(point_frames(3, 100) == std::vector<int>{1});
  CHECK(point_frames(1, 1) == std::vector<int>{0});
}

TEST_CASE("a live background continues with images of another size") {
  LiveBackground background = of_wall();
  const auto at_half = [](const cv::Mat& image) {
    cv::Mat half;
    cv::resize(image, half, {50, 40}, 0, 0, cv::INTER_AREA);
    return half;
  };
  const cv::Mat box = with_box(kPlace), small_wall = at_half(wall()), small_box = at_half(box);
  for (int frames = 0; frames < kRestFrames / 2; frames += kWindow)
    see(background, {box, box, box});
  background.resize(small_wall.size());
  CHECK(cv::countNonZero(background.mask(small_wall)) == 0);
  CHECK(background.mask(small_box).at<std::uint8_t>(kInside / 2) == 255);
  // The time at rest counts from before.
  for (int frames = 0; frames < kRestFrames / 2; frames += kWindow)
    see(background, {small_box, small_box, small_box});
  CHECK(background.mask(small_box).at<std::uint8_t>(kInside / 2) == 0);
  CHECK(background.still().at<std::uint8_t>(kOutside / 2) == 255);
  background.resize(box.size());
  CHECK(share_of(background.mask(box)) < 0.01);
}
