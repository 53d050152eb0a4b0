// SPDX-License-Identifier: Apache-2.0
#include "init/components.h"

#include <map>
#include <opencv2/imgproc.hpp>
#include <random>

#include "catch.h"

namespace stgs::encoder::init {
namespace {

// 255 in about `percent` of the pixels, in blobs.
cv::Mat random_mask(cv::Size size, int percent, unsigned seed) {
  std::mt19937 random(seed);
  cv::Mat noise(size, CV_8U), mask;
  for (std::size_t i = 0; i < noise.total(); ++i)
    noise.data[i] = random() % 100 < unsigned(percent) ? 255 : 0;
  cv::medianBlur(noise, mask, 3);
  return mask;
}

// Checks the components against OpenCV's.
void check_components(const cv::Mat& mask, std::uint8_t value, bool diagonal) {
  const Components found = find_components(mask, value, diagonal);
  cv::Mat labels, stats, centroids;
  const int count = cv::connectedComponentsWithStats(mask == value, labels, stats, centroids,
                                                     diagonal ? 8 : 4, CV_32S);
  REQUIRE(int(found.components.size()) == count - 1);
  std::map<int, int> label_of;
  int covered = 0;
  for (const Run& run : found.runs) {
    covered += run.last - run.first;
    for (int x = run.first; x < run.last; ++x) {
      const int label = labels.at<int>(run.y, x);
      REQUIRE(label > 0);
      REQUIRE(label_of.try_emplace(run.component, label).first->second == label);
    }
  }
  CHECK(covered == cv::countNonZero(mask == value));
  for (const auto& [component, label] : label_of) {
    const cv::Rect box(
        stats.at<int>(label, cv::CC_STAT_LEFT), stats.at<int>(label, cv::CC_STAT_TOP),
        stats.at<int>(label, cv::CC_STAT_WIDTH), stats.at<int>(label, cv::CC_STAT_HEIGHT));
    CHECK(found.components[component].area == stats.at<int>(label, cv::CC_STAT_AREA));
    CHECK(found.components[component].at_border ==
          (box.x == 0 || box.y == 0 || box.br().x == mask.cols || box.br().y == mask.rows));
  }
}

TEST_CASE("components of masks equal those of OpenCV", "[motion]") {
  for (const bool diagonal : {false, true}) {
    for (const std::uint8_t value : {std::uint8_t{0}, std::uint8_t{255}}) {
      for (const int percent : {0, 30, 50, 70, 100}) {
        CAPTURE(diagonal, int(value), percent);
        check_components(random_mask({97, 61}, percent, unsigned(percent)), value, diagonal);
      }
      check_components(random_mask({1, 40}, 50, 1), value, diagonal);
      check_components(random_mask({40, 1}, 50, 2), value, diagonal);
    }
  }
}

}  // namespace
}  // namespace stgs::encoder::init
