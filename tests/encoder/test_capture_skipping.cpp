// SPDX-License-Identifier: Apache-2.0
// Videos that are read from a late frame on.
#include <cstdio>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/decode_start.h"
#include "src/capture/frame_reader.h"
#include "src/capture/video_decoder.h"

namespace stgs::encoder::capture_test {
namespace {

constexpr int kFrames = 400;
constexpr int kSide = 64;

// An image that states its number: 16 blocks, white for 1.
cv::Mat numbered(int number) {
  cv::Mat image(kSide, kSide, CV_8UC3, cv::Scalar::all(20));
  for (int bit = 0; bit < 16; ++bit) {
    if ((number >> bit & 1) != 0)
      image(cv::Rect(bit % 4 * 16, bit / 4 * 16, 16, 16)).setTo(cv::Scalar::all(230));
  }
  return image;
}

int number_of(const cv::Mat& image) {
  int number = 0;
  for (int bit = 0; bit < 16; ++bit)
    number |= int{image.at<cv::Vec3b>(bit / 4 * 16 + 8, bit % 4 * 16 + 8)[1] > 128} << bit;
  return number;
}

// Writes numbered frames, by the program ffmpeg with these options.
void write_numbered(const std::string& path, const std::string& options) {
  const std::string command =
      fmt::format("ffmpeg -v error -y -f rawvideo -pix_fmt bgr24 -s {}x{} -r 30 -i - {} '{}'",
                  kSide, kSide, options, path);
  std::FILE* const pipe = ::popen(command.c_str(), "w");
  REQUIRE(pipe != nullptr);
  for (int f = 0; f < kFrames; ++f) {
    const cv::Mat image = numbered(f);
    REQUIRE(std::fwrite(image.data, 1, image.total() * 3, pipe) == image.total() * 3);
  }
  REQUIRE(::pclose(pipe) == 0);
}

struct Video {
  const char *name, *options;
  int decoded;  // frames that are decoded to reach frame 350, at most; 0: all
};
const Video kVideos[] = {
    {"closed.mp4", "-c:v libx264 -g 50 -bf 3 -x264-params open-gop=0", 60},
    {"no_b.mp4", "-c:v libx264 -g 50 -bf 0", 60},
    {"long.mkv", "-c:v libx264 -g 250 -bf 3", 110},
    {"open.mkv", "-c:v libx264 -g 50 -bf 3 -x264-params open-gop=1:b-adapt=0", 0},
    {"refresh.mkv", "-c:v libx264 -g 50 -bf 0 -x264-params intra-refresh=1", 0},
    {"shifted.mp4", "-c:v libx264 -g 50 -bf 3 -output_ts_offset 0.4", 60},
    {"all.avi", "-c:v mjpeg -q:v 2", 10},
    {"part2.mp4", "-c:v mpeg4 -g 50 -bf 2", 0},
};

}  // namespace

TEST_CASE("decoding starts with the last key frame that later frames do not precede") {
  // Times in the order of decoding; k: a key frame.
  const auto start = [](std::initializer_list<int> times, std::initializer_list<std::size_t> keys,
                        std::size_t first) {
    std::vector<StoredFrame> stored;
    for (const int time : times) stored.push_back({time, false});
    for (const std::size_t key : keys) stored[key].is_key = true;
    return decode_start(stored, first);
  };
  CHECK(start({0, 1, 2, 3, 4, 5}, {0, 3}, 5) == 3);
  CHECK(start({0, 1, 2, 3, 4, 5}, {0, 3}, 3) == 3);
  CHECK(start({0, 1, 2, 3, 4, 5}, {0, 3}, 2) == 0);
  CHECK(start({0, 1, 2, 3, 4, 5}, {0, 1, 2, 3, 4, 5}, 4) == 4);
  CHECK(start({0, 3, 1, 2, 4, 7, 5, 6}, {0, 4}, 6) == 4);  // closed groups
  CHECK(start({0, 3, 1, 2, 6, 4, 5, 7}, {0, 4}, 7) == 0);  // frames 4 and 5 precede key 6
  CHECK(start({0, 1, 2, 6, 4, 5, 9, 7, 8}, {0, 2, 3, 6}, 8) == 2);
  CHECK(start({0, 3, 2, 4, 5}, {0, 2}, 4) == 0);  // frame 3 follows key 2
  CHECK(start({0, 1, 1, 2}, {0, 2}, 3) == 0);     // a time that occurs twice
  CHECK(start({}, {}, 3) == 0);
}

TEST_CASE("a late frame of a video is the same as if all were decoded") {
  const TemporaryFolder folder;
  for (const Video& video : kVideos) {
    INFO(video.name);
    SourceCamera camera;
    camera.name = "cam";
    camera.video = folder / video.name;
    write_numbered(camera.video, video.options);
    const auto files = files_of(folder);
    const auto all = VideoReader::open(*files, camera, 0);
    REQUIRE(all.ok());
    std::vector<cv::Mat> images;
    const int count = probe_frames(*files, camera)->frames;
    REQUIRE(count == kFrames);
    for (int f = 0; f < count; ++f) images.push_back((*all)->next(kSide, kSide)->clone());
    for (const int first : {257, 299, 300, 301, 350, 351, 352, count - 1}) {
      INFO(first);
      const auto late = VideoReader::open(*files, camera, first);
      REQUIRE(late.ok());
      for (int f = first; f < std::min(first + 3, count); ++f) {
        const auto image = (*late)->next(kSide, kSide);
        REQUIRE(image.ok());
        CHECK(number_of(*image) == f);
        CHECK(cv::norm(*image, images[std::size_t(f)], cv::NORM_INF) == 0);
      }
    }
    CHECK(VideoReader::open(*files, camera, count + 1).status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("few frames are decoded to reach a late frame") {
  const TemporaryFolder folder;
  for (const Video& video : kVideos) {
    INFO(video.name);
    const std::string path = folder / video.name;
    write_numbered(path, video.options);
    int stored = 0;
    const auto decoder = VideoDecoder::open(path, path, [&](auto) {
      ++stored;
      return Status();
    });
    REQUIRE(decoder.ok());
    const Result<bool> skipped = (*decoder)->skip_to(350);
    REQUIRE(skipped.ok());
    CHECK(*skipped == (video.decoded > 0));
    // All up to it are listed, and those that are decoded are checked again.
    if (*skipped) CHECK(stored <= 350 + int(kMaxReordered) + video.decoded);
  }
}

}  // namespace stgs::encoder::capture_test
