// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "catch.h"
#include "stgs/encoder/image_file.h"

namespace stgs::encoder {
namespace {

// The left half is noise, the right half flat.
Image8 half_noise(int width, int height, int channels) {
  std::mt19937 random(7);
  Image8 image{width, height, channels, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width * channels; ++x)
      image.data.push_back(2 * x < width * channels ? static_cast<std::uint8_t>(random()) : 200);
  }
  return image;
}

TEST_CASE("a written PNG file has the image, for both decoders", "[image]") {
  for (const int channels : {1, 3}) {
    for (const auto& [width, height] : {std::pair{1, 1}, {1, 9}, {9, 1}, {640, 480}}) {
      CAPTURE(channels, width, height);
      const Image8 image = half_noise(width, height, channels);
      const std::vector<std::uint8_t> bytes = encode_png(image);
      const Result<Image8> decoded = decode_image8(bytes, channels, "test.png");
      REQUIRE(decoded.ok());
      CHECK(decoded->width == width);
      CHECK(decoded->height == height);
      CHECK(decoded->data == image.data);
      // This one checks the checksums.
      cv::Mat other = cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
      REQUIRE(other.channels() == channels);
      if (channels == 3) cv::cvtColor(other, other, cv::COLOR_BGR2RGB);
      CHECK(std::vector<std::uint8_t>(other.datastart, other.dataend) == image.data);
    }
  }
}

TEST_CASE("a flat image takes few bytes", "[image]") {
  Image8 image{640, 480, 3, {}};
  image.data.assign(std::size_t{640} * 480 * 3, 90);
  CHECK(encode_png(image).size() < 10000);
}

}  // namespace
}  // namespace stgs::encoder
