// SPDX-License-Identifier: Apache-2.0
// Videos: their colours and rotation; headers and tables that state more than their bytes hold.
#include <cmath>
#include <cstring>
#include <functional>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/frame_reader.h"
#include "stgs/encoder/image_file.h"

namespace stgs::encoder::capture_test {
namespace {

std::string big_endian(std::initializer_list<std::uint32_t> values, int bytes = 4) {
  std::string out;
  for (const std::uint32_t value : values) {
    for (int b = bytes - 1; b >= 0; --b) out += static_cast<char>(value >> (8 * b) & 0xff);
  }
  return out;
}

std::string box(const char* type, const std::string& content) {
  return big_endian({static_cast<std::uint32_t>(8 + content.size())}) + type + content;
}

std::string full_box(const char* type, const std::string& content) {
  return box(type, std::string(4, '\0') + content);
}

// A matrix that leaves frames as they are.
const std::string kUnity = big_endian({0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 1u << 30});

// How an MP4 describes its frames: the codec, boxes after the description, and the matrix by which
// players rotate them.
struct Description {
  std::string codec = "jpeg", extra = {};
  std::string matrix = kUnity;
  std::uint32_t stored_frames = 1;  // of equal numbers of bytes
};

// An MP4 whose table lists the stored frames in turn, `frames` in total.
std::string repeating_video(const std::string& stored, std::uint32_t frames, std::uint32_t width,
                            std::uint32_t height, const Description& description = {}) {
  const std::string zeros(32, '\0');
  const std::string begin = box("ftyp", std::string("isom\0\0\2\0isommp41", 16));
  const auto offset = static_cast<std::uint32_t>(begin.size() + 8);
  const auto size = static_cast<std::uint32_t>(stored.size()) / description.stored_frames;
  const std::string entry =
      box(description.codec.c_str(), zeros.substr(0, 6) + big_endian({1}, 2) + zeros.substr(0, 16) +
                                         big_endian({width, height}, 2) +
                                         big_endian({0x480000, 0x480000, 0}) + big_endian({1}, 2) +
                                         zeros + big_endian({24, 0xffff}, 2) + description.extra);
  std::string offsets = big_endian({frames});
  for (std::uint32_t i = 0; i < frames; ++i)
    offsets += big_endian({offset + i % description.stored_frames * size});
  const std::string table =
      box("stbl", full_box("stsd", big_endian({1}) + entry) +
                      full_box("stts", big_endian({1, frames, 1000})) +
                      full_box("stsc", big_endian({1, 1, 1, 1})) +
                      full_box("stsz", big_endian({size, frames})) + full_box("stco", offsets));
  const std::string media = box(
      "mdia", full_box("mdhd", big_endian({0, 0, 30000, frames * 1000, 0x55c40000})) +
                  full_box("hdlr", zeros.substr(0, 4) + "vide" + zeros.substr(0, 14)) +
                  box("minf", full_box("vmhd", zeros.substr(0, 8)) +
                                  box("dinf", full_box("dref", big_endian({1}) +
                                                                   box("url ", big_endian({1})))) +
                                  table));
  const std::string track = big_endian({3}) + big_endian({0, 0, 1, 0, frames * 1000}) +
                            zeros.substr(0, 16) + description.matrix +
                            big_endian({width << 16, height << 16});
  const std::string movie = big_endian({0, 0, 30000, frames * 1000, 0x10000, 0x01000000}) +
                            zeros.substr(0, 8) + kUnity + zeros.substr(0, 24) + big_endian({2});
  return begin + box("mdat", stored) +
         box("moov", full_box("mvhd", movie) + box("trak", box("tkhd", track) + media));
}

std::string jpeg_of(const cv::Mat& image, int quality) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  return {bytes.begin(), bytes.end()};
}

SourceCamera camera_of(const std::string& path) {
  SourceCamera camera;
  camera.name = "cam";
  camera.video = path;
  return camera;
}

TEST_CASE("a video that states more frames than its bytes can hold is rejected") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mp4");
  const cv::Mat small = test_image(0, 0), large(4096, 4096, CV_8UC3, cv::Scalar::all(128));
  const auto probed = [&](const cv::Mat& image, std::uint32_t frames) {
    write_bytes(camera.video,
                repeating_video(jpeg_of(image, 30), frames, static_cast<std::uint32_t>(image.cols),
                                static_cast<std::uint32_t>(image.rows)));
    return probe_frames(*files_of(folder), camera);
  };
  const Result<FrameInfo> few = probed(small, 20);
  INFO(few.status().message());
  REQUIRE(few.ok());
  CHECK(few->frames == 20);
  CHECK(few->width == kWidth);
  for (const auto& [image, frames] : {std::pair(small, 100'000), std::pair(large, 900'000)}) {
    const Status status = probed(image, static_cast<std::uint32_t>(frames)).status();
    INFO(status.message());
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {"a.mp4", fmt::format("states {} frames", frames), "can hold"}));
  }
}

TEST_CASE("reading ends at frames that a table repeats") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mp4");
  cv::Mat noise(1024, 1024, CV_8UC3);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const std::string jpeg = jpeg_of(noise, 100);
  const auto enough = static_cast<int>((2 * jpeg.size() + (18u << 20)) / jpeg.size()) + 1;
  write_bytes(camera.video,
              repeating_video(jpeg, static_cast<std::uint32_t>(enough) + 30, 1024, 1024));
  const auto files = files_of(folder);
  const Result<FrameInfo> info = probe_frames(*files, camera);
  REQUIRE(info.ok());
  CHECK(info->frames == enough + 30);
  auto video = VideoReader::open(*files, camera, 0);
  REQUIRE(video.ok());
  Status status;
  int read = 0;
  for (; status.ok() && read < enough; ++read) status = (*video)->next(1024, 1024).status();
  INFO(status.message());
  CHECK(read > 2);
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"a.mp4", "same stored frames"}));
  // Also while the frames before the first are skipped.
  CHECK(fails_with(VideoReader::open(*files, camera, enough).status(), {"same stored frames"}));
}

TEST_CASE("a black video is read, and a size in a header is checked before decoding") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mp4");
  {
    cv::VideoWriter video(camera.video, cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 30,
                          {1920, 1080});
    for (int f = 0; f < 40; ++f) video.write(cv::Mat(1080, 1920, CV_8UC3, cv::Scalar::all(0)));
  }
  const auto files = files_of(folder);
  REQUIRE(probe_frames(*files, camera).ok());
  auto video = VideoReader::open(*files, camera, 30);
  REQUIRE(video.ok());
  for (int f = 30; f < 40; ++f) CHECK((*video)->next(1920, 1080).ok());
  // The frame cannot be decoded, but the size is refused first.
  write_bytes(camera.video, repeating_video(std::string(500, 'x'), 2, 40'000, 16));
  CHECK(fails_with(probe_frames(*files, camera).status(), {"a.mp4", "40000x16"}));
}

TEST_CASE("JPEG headers that state more pixels than the bytes can hold are refused") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mp4");
  std::string jpeg = jpeg_of(test_image(0, 0), 90);
  const auto probed = [&] {
    write_bytes(camera.video, repeating_video(jpeg, 2, kWidth, kHeight));
    return probe_frames(*files_of(folder), camera).status();
  };
  CHECK(probed().ok());
  const std::vector<std::uint8_t> valid(jpeg.begin(), jpeg.end());
  CHECK(decode_image8(valid, 3, "a.jpg").ok());
  // A second header, before the first one: 17 bytes, 8 bits, 8000 x 8000, three components.
  const std::string header = "\xff\xc2" + big_endian({17}, 2) + '\x08' +
                             big_endian({8000, 8000}, 2) +
                             std::string("\3\1\x11\0\2\x11\0\3\x11\0", 10);
  jpeg.insert(2, header);
  const Status status = probed();
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"a.mp4", "JPEG image", "more pixels"}));
  // Not a header that decoders accept, as bytes of other codecs may look.
  CHECK(has_oversized_jpeg(std::vector<std::uint8_t>(header.begin(), header.end())));
  for (const auto& [at, value] : {std::pair(4, 17), std::pair(11, 1), std::pair(12, 4)}) {
    std::vector<std::uint8_t> other(header.begin(), header.end());
    other[static_cast<std::size_t>(at)] = static_cast<std::uint8_t>(value);
    CHECK_FALSE(has_oversized_jpeg(other));
  }
  CHECK_FALSE(has_oversized_jpeg(std::vector<std::uint8_t>(header.begin(), header.end() - 1)));
  // The only header of an image.
  const std::string image = "\xff\xd8" + header + std::string("\xff\xda\0\2\xff\xd9", 6);
  const std::vector<std::uint8_t> bytes(image.begin(), image.end());
  CHECK(fails_with(decode_image8(bytes, 3, "a.jpg").status(), {"a.jpg", "64000000 pixels"}));
}

// An uncompressed frame: per pair of pixels Cb, Y, Cr, Y. Luma is 120, Cb 128.
std::string uncompressed(int width, int height, const std::function<int(int pair)>& cr) {
  std::string bytes;
  for (int k = 0; k < width / 2 * height; ++k) {
    for (const int value : {128, 120, cr(k % (width / 2)), 120}) bytes += static_cast<char>(value);
  }
  return bytes;
}

// Codes of the primaries, of the transfer function and of the matrix; the range.
std::string colour_box(std::uint32_t code, bool full_range) {
  return box("colr", "nclx" + big_endian({code, code, code}, 2) +
                         std::string(1, full_range ? '\x80' : '\0'));
}

cv::Mat first_frame(const CaptureFolder& files, const SourceCamera& camera) {
  const Result<FrameInfo> info = probe_frames(files, camera);
  INFO(info.status().message());
  REQUIRE(info.ok());
  auto video = VideoReader::open(files, camera, 0);
  REQUIRE(video.ok());
  Result<cv::Mat> image = (*video)->next(info->width, info->height);
  INFO(image.status().message());
  REQUIRE(image.ok());
  return *image;
}

TEST_CASE("videos are converted with the matrix and the range that they state") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mov");
  const auto files = files_of(folder);
  // Red and green per step of Cr in BT.709 and BT.601, and luma, by the range.
  struct Case {
    std::string colour;
    double red, green, luma;
    int width = 32;
  };
  const double limited = 255.0 / 224, luma = (120 - 16) * 255.0 / 219;
  for (const Case& c : {Case{colour_box(1, false), 1.5748 * limited, -0.4681 * limited, luma},
                        Case{colour_box(6, false), 1.402 * limited, -0.7141 * limited, luma},
                        Case{colour_box(1, true), 1.5748, -0.4681, 120},
                        Case{colour_box(6, true), 1.402, -0.7141, 120},
                        // Not stated: as small videos usually are.
                        Case{"", 1.402 * limited, -0.7141 * limited, luma},
                        Case{"", 1.5748 * limited, -0.4681 * limited, luma, 1280}}) {
    write_bytes(camera.video, repeating_video(uncompressed(c.width, 4, [](int) { return 158; }), 2,
                                              static_cast<std::uint32_t>(c.width), 4,
                                              {.codec = "2vuy", .extra = c.colour}));
    const cv::Vec3b found = first_frame(*files, camera).at<cv::Vec3b>(2, 16);
    INFO(c.red << ": " << static_cast<cv::Vec3i>(found));
    CHECK(std::abs(found[2] - (c.luma + 30 * c.red)) <= 1.5);
    CHECK(std::abs(found[1] - (c.luma + 30 * c.green)) <= 1.5);
    CHECK(std::abs(found[0] - c.luma) <= 1.5);
  }
}

TEST_CASE("chroma is interpolated from its stated position") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mov");
  const auto files = files_of(folder);
  write_bytes(camera.video,
              repeating_video(uncompressed(32, 4, [](int pair) { return 100 + 4 * pair; }), 2, 32,
                              4, {.codec = "2vuy", .extra = colour_box(6, true)}));
  const cv::Mat image = first_frame(*files, camera);
  for (int x = 4; x < 28; ++x) {  // away from the borders
    INFO("column " << x << ": " << static_cast<cv::Vec3i>(image.at<cv::Vec3b>(2, x)));
    // Cr grows by 2 per pixel, and is that of a pair at its first pixel.
    CHECK(std::abs(image.at<cv::Vec3b>(2, x)[2] - (120 + 1.402 * (100 + 2 * x - 128))) <= 1.5);
  }
}

TEST_CASE("a matrix that FFmpeg lacks is refused") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mov");
  write_bytes(camera.video, repeating_video(uncompressed(32, 4, [](int) { return 128; }), 2, 32, 4,
                                            {.codec = "2vuy", .extra = colour_box(14, false)}));
  const Status status = probe_frames(*files_of(folder), camera).status();
  INFO(status.message());
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK(fails_with(status, {"a.mov", "frame 0", "ictcp", "BT.709"}));
}

TEST_CASE("a frame of another size than the first is refused, also while frames are skipped") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mp4");
  std::string small = jpeg_of(cv::Mat(16, 32, CV_8UC3, cv::Scalar::all(90)), 90),
              large = jpeg_of(cv::Mat(64, 128, CV_8UC3, cv::Scalar::all(90)), 90);
  small.resize(2000);
  large.resize(2000);
  write_bytes(camera.video, repeating_video(small + large, 6, 32, 16, {.stored_frames = 2}));
  const auto files = files_of(folder);
  const Status status = VideoReader::open(*files, camera, 3).status();
  INFO(status.message());
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"a.mp4", "frame 1", "differs in size", "32x16", "128x64"}));
}

TEST_CASE("frames are rotated as the video states") {
  const TemporaryFolder folder;
  const SourceCamera camera = camera_of(folder / "a.mov");
  const auto files = files_of(folder);
  constexpr std::uint32_t kOne = 0x10000, kMinus = 0xffff0000, kLast = 1u << 30;
  cv::Mat stored(16, 32, CV_8UC3, cv::Scalar(20, 20, 20));
  stored(cv::Rect(0, 0, 16, 8)).setTo(cv::Scalar(220, 220, 220));  // top left
  const auto bright = [&](const std::string& matrix) {
    write_bytes(camera.video, repeating_video(jpeg_of(stored, 95), 2, 32, 16, {.matrix = matrix}));
    const cv::Mat image = first_frame(*files, camera);
    const auto at = [&](int x, int y) {
      return image.at<cv::Vec3b>(y * (image.rows - 1), x * (image.cols - 1))[0] > 128;
    };
    std::string corners;
    for (const auto& [x, y] : {std::pair(0, 0), std::pair(1, 0), std::pair(1, 1), std::pair(0, 1)})
      corners += at(x, y) ? '1' : '0';
    return fmt::format("{}x{} {}", image.cols, image.rows, corners);
  };
  CHECK(bright(kUnity) == "32x16 1000");
  CHECK(bright(big_endian({0, kOne, 0, kMinus, 0, 0, 0, 0, kLast})) == "16x32 0100");
  CHECK(bright(big_endian({kMinus, 0, 0, 0, kMinus, 0, 0, 0, kLast})) == "32x16 0010");
  CHECK(bright(big_endian({0, kMinus, 0, kOne, 0, 0, 0, 0, kLast})) == "16x32 0001");
}

}  // namespace
}  // namespace stgs::encoder::capture_test
