// SPDX-License-Identifier: Apache-2.0
// Images of the stages of an initialisation.
#include <opencv2/imgproc.hpp>

#include "catch.h"
#include "init/view.h"

namespace stgs::encoder::init {

TEST_CASE("images are scaled down as by OpenCV, by whole factors and others") {
  cv::RNG random(3);
  for (const auto& [large, small] : {std::pair(cv::Size(1920, 1080), cv::Size(320, 180)),
                                     std::pair(cv::Size(330, 27), cv::Size(110, 9)),
                                     std::pair(cv::Size(2048, 1024), cv::Size(8, 4)),
                                     std::pair(cv::Size(1030, 515), cv::Size(2, 1)),
                                     std::pair(cv::Size(640, 360), cv::Size(320, 180)),
                                     std::pair(cv::Size(640, 360), cv::Size(200, 120)),
                                     std::pair(cv::Size(700, 360), cv::Size(233, 120)),
                                     std::pair(cv::Size(64, 48), cv::Size(64, 48))}) {
    INFO(large << " to " << small);
    cv::Mat image(large, CV_8UC3);
    random.fill(image, cv::RNG::UNIFORM, 0, 256);
    for (const bool is_white : {false, true}) {
      if (is_white) image.setTo(255);
      cv::Mat found(small, CV_8UC3), expected;
      const std::uint8_t* const memory = found.data;
      scale_down(image, found);
      cv::resize(image, expected, small, 0, 0, cv::INTER_AREA);
      CHECK(found.data == memory);
      CHECK(cv::norm(found, expected, cv::NORM_INF) == 0);
    }
  }
}

}  // namespace stgs::encoder::init
