// SPDX-License-Identifier: Apache-2.0
// The pixels that a GPU computes, on the CPU: those of swscale and of OpenCV.
#include <cstring>
#include <random>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/camera_plan.h"
#include "src/capture/ffmpeg_types.h"
#include "src/capture/frame_converter.h"
#include "src/geometry/warp_tables.h"

namespace stgs::encoder::capture_test {
namespace {

using namespace geometry;

using ffmpeg::Frame;

struct Format {
  int width, height, bits;
  bool full_range;
  AVChromaLocation chroma;
  AVColorSpace matrix;
};

// Returns a frame of noise; an extreme one has the smallest and the largest values alone, in runs.
Frame noise(const Format& format, bool is_extreme = false) {
  Frame frame(av_frame_alloc());
  frame->format = format.bits == 8 ? AV_PIX_FMT_YUV420P : AV_PIX_FMT_YUV420P10;
  frame->width = format.width;
  frame->height = format.height;
  frame->color_range = format.full_range ? AVCOL_RANGE_JPEG : AVCOL_RANGE_MPEG;
  frame->chroma_location = format.chroma;
  frame->colorspace = format.matrix;
  REQUIRE(av_frame_get_buffer(frame.get(), 0) >= 0);
  std::mt19937 random(5);
  for (int p = 0; p < 3; ++p) {
    const int rows = p == 0 ? format.height : format.height / 2;
    for (int i = 0; i < rows * frame->linesize[p] / (format.bits == 8 ? 1 : 2); ++i) {
      auto value = random() % (1u << format.bits);
      if (is_extreme) value = ((i / 24 + p) % 3 == 0) ? 0 : (1u << format.bits) - 1;
      if (format.bits == 8)
        frame->data[p][i] = static_cast<std::uint8_t>(value);
      else
        reinterpret_cast<std::uint16_t*>(frame->data[p])[i] = static_cast<std::uint16_t>(value);
    }
  }
  return frame;
}

cv::Mat by_rule(const AVFrame& frame, int bits, const YuvRule& rule) {
  const YuvPlanes planes{frame.data[0],
                         frame.data[1],
                         frame.data[2],
                         static_cast<std::size_t>(frame.linesize[0]),
                         static_cast<std::size_t>(frame.linesize[1]),
                         1,
                         frame.width,
                         frame.height,
                         bits,
                         0};
  cv::Mat out(frame.height, frame.width, CV_8UC3);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      const Bgr pixel = yuv_pixel(planes, rule.coefficients, rule.columns[std::size_t(x)],
                                  rule.rows[std::size_t(y)], x, y);
      out.at<cv::Vec3b>(y, x) = {pixel.b, pixel.g, pixel.r};
    }
  }
  return out;
}

cv::Mat noisy_image(int width, int height) {
  cv::Mat image(height, width, CV_8UC3);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

PackedImage packed(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step[0], image.channels()};
}

}  // namespace

TEST_CASE("the conversion of a GPU has the pixels of swscale") {
  FrameConverter converter;
  for (const Format& format :
       {Format{320, 180, 8, false, AVCHROMA_LOC_LEFT, AVCOL_SPC_BT709},
        Format{322, 182, 8, true, AVCHROMA_LOC_CENTER, AVCOL_SPC_SMPTE170M},
        Format{64, 48, 8, false, AVCHROMA_LOC_TOPLEFT, AVCOL_SPC_BT2020_NCL},
        Format{64, 48, 8, false, AVCHROMA_LOC_BOTTOM, AVCOL_SPC_UNSPECIFIED},
        Format{16, 16, 8, false, AVCHROMA_LOC_UNSPECIFIED, AVCOL_SPC_BT709},
        Format{1280, 64, 10, false, AVCHROMA_LOC_LEFT, AVCOL_SPC_UNSPECIFIED},
        Format{322, 182, 10, true, AVCHROMA_LOC_BOTTOMLEFT, AVCOL_SPC_BT709}}) {
    INFO(format.width << "x" << format.height << ", " << format.bits << " bits");
    for (const bool is_extreme : {false, true}) {
      const Frame frame = noise(format, is_extreme);
      const auto stated = static_cast<AVPixelFormat>(frame->format);
      const auto rule = converter.gpu_rule(*frame, stated);
      REQUIRE(rule);
      CHECK(converter.gpu_rule(*frame, stated) == rule);
      const auto expected = converter.convert(*frame, stated);
      REQUIRE(expected.ok());
      CHECK(cv::norm(by_rule(*frame, format.bits, *rule), *expected, cv::NORM_INF) == 0);
    }
  }
}

TEST_CASE("a GPU does not convert frames of odd or tiny sizes") {
  FrameConverter converter;
  for (const auto& [width, height] :
       {std::pair(321, 180), std::pair(320, 181), std::pair(14, 64)}) {
    const Frame frame(av_frame_alloc());
    frame->width = width;
    frame->height = height;
    frame->format = AV_PIX_FMT_YUV420P;
    CHECK(!converter.gpu_rule(*frame, AV_PIX_FMT_YUV420P));
  }
}

TEST_CASE("the undistortion of a GPU has the pixels of OpenCV") {
  const cv::Mat image = noisy_image(320, 180);
  SourceCamera camera;
  camera.name = "a";
  camera.fx = camera.fy = 250;
  camera.cx = 161;
  camera.cy = 88;
  camera.lens = LensModel::kOpenCv;
  camera.distortion = {-0.5, 0.2, 0.01, -0.02};
  const auto plan = plan_camera(camera, {320, 180, 1, 30}, 1);
  REQUIRE(plan.ok());
  const FrameMapping mapping(*plan);
  const cv::Mat before = image.clone();
  const auto expected = mapping.frame(image);
  REQUIRE(expected.ok());
  CHECK(cv::norm(image, before, cv::NORM_INF) == 0);
  const std::vector<std::int16_t> weights = warp_weights();
  cv::Mat found(image.size(), CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const WarpPosition at =
          warp_position(mapping.map_x().at<float>(y, x), mapping.map_y().at<float>(y, x));
      for (int c = 0; c < 3; ++c)
        found.at<cv::Vec3b>(y, x)[c] = warped_sample(packed(image), at, weights.data(), c);
    }
  }
  CHECK(cv::norm(found, *expected, cv::NORM_INF) == 0);
}

TEST_CASE("the scaling of a GPU differs from that of OpenCV by 1 at most") {
  const cv::Mat image = noisy_image(321, 180);
  for (const cv::Size size : {cv::Size(160, 90), cv::Size(107, 60), cv::Size(320, 180),
                              cv::Size(241, 135), cv::Size(100, 56), cv::Size(3, 2)}) {
    INFO(size);
    cv::Mat expected, found(size, CV_8UC3);
    cv::resize(image, expected, size, 0, 0, cv::INTER_AREA);
    const auto columns = area_spans(image.cols, size.width);
    const auto rows = area_spans(image.rows, size.height);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        for (int c = 0; c < 3; ++c)
          found.at<cv::Vec3b>(y, x)[c] =
              area_sample(packed(image), columns[std::size_t(x)], rows[std::size_t(y)], c);
    CHECK(cv::norm(found, expected, cv::NORM_INF) <= 1);
  }
}

TEST_CASE("rotated pixels are where OpenCV puts them") {
  const cv::Mat image = noisy_image(7, 5);
  for (int quarters = 1; quarters < 4; ++quarters) {
    cv::Mat expected, found;
    cv::rotate(image, expected, quarters - 1);
    found.create(expected.size(), CV_8UC3);
    for (int y = 0; y < image.rows; ++y)
      for (int x = 0; x < image.cols; ++x)
        found.ptr<cv::Vec3b>()[rotated_index(quarters, image.cols, image.rows, x, y)] =
            image.at<cv::Vec3b>(y, x);
    CHECK(cv::norm(found, expected, cv::NORM_INF) == 0);
  }
}

}  // namespace stgs::encoder::capture_test
