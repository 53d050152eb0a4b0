// SPDX-License-Identifier: Apache-2.0
// The choice between the CPU and the video decoder of a GPU, on machines without one.
#include <filesystem>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/h264_parameters.h"
#include "src/capture/video_decoder.h"
#include "src/capture/write_frames.h"

namespace stgs::encoder::capture_test {
namespace {

PrepareSettings settings_of(const std::string& video_decoder, const std::string& backend) {
  PrepareSettings settings;
  settings.video_decoder = video_decoder;
  settings.backend = backend;
  return settings;
}

bool has_gpu() {
  return fs::exists("/dev/nvidiactl");
}

}  // namespace

TEST_CASE("the CPU decodes short videos, and all if it is chosen, also as the backend") {
  struct Choice {
    PrepareSettings settings;
    std::int64_t pixels;
  };
  for (const Choice& choice : {Choice{settings_of("cpu", "auto"), kEndless},
                               {settings_of("cpu", "cuda"), kEndless},
                               {settings_of("auto", "cpu"), kEndless},
                               {settings_of("auto", "auto"), 30 * 640 * 360}}) {
    std::vector<std::string> lines;
    const auto chosen =
        choose_video_decoding(choice.settings, choice.pixels,
                              [&](int, const std::string& line) { lines.push_back(line); });
    REQUIRE(chosen.ok());
    CHECK(chosen->device == nullptr);
    CHECK(!chosen->required);
    CHECK(lines.empty());
  }
}

TEST_CASE("an unknown video decoder is a usage error") {
  const Status status = choose_video_decoding(settings_of("vulkan", "auto"), 0, {}).status();
  CHECK(status.code() == StatusCode::kUsage);
  CHECK(fails_with(status, {"vulkan", "auto, cpu or cuda"}));
}

TEST_CASE("without a GPU, the CPU decodes videos, and the log states why") {
  if (has_gpu()) return;
  std::vector<std::string> lines;
  const auto chosen =
      choose_video_decoding(settings_of("auto", "auto"), kEndless,
                            [&](int, const std::string& line) { lines.push_back(line); });
  REQUIRE(chosen.ok());
  CHECK(chosen->device == nullptr);
  REQUIRE(lines.size() == 1);
  CHECK(lines[0].find("NVDEC unavailable (") == 0);
  CHECK(lines[0].find("videos on the CPU") != std::string::npos);
}

TEST_CASE("without a GPU, a required video decoder is an error before any work") {
  if (has_gpu()) return;
  const TemporaryFolder folder;
  const Status status =
      prepare(folder / "none", folder / "out", settings_of("cuda", "cpu"), {}, {});
  CHECK((status.code() == StatusCode::kUnsupported || status.code() == StatusCode::kNotBuilt));
  CHECK(fails_with(status, {"use --video-decoder cpu"}));
}

TEST_CASE("the log states the decoders of the videos of a capture") {
  SourceCapture source;
  source.folder = "rig";
  OpenVideos videos;
  class Reader final : public VideoReader {
   public:
    explicit Reader(std::string refusal) : by_{false, std::move(refusal)} {}
    Result<cv::Mat> next(int, int, const FrameMapping*) override { return cv::Mat(); }
    DecodedBy decoded_by() const override { return by_; }

   private:
    DecodedBy by_;
  };
  for (const char* refusal : {"", "no", "no"}) {
    const std::string name(1, static_cast<char>('a' + source.cameras.size()));
    source.cameras.emplace_back().name = name;
    videos.videos.emplace_back().reader = std::make_unique<Reader>(refusal);
  }
  source.cameras.emplace_back();  // of images
  videos.videos.emplace_back();
  std::vector<std::string> lines;
  log_decoders(source, videos, [&](int, const std::string& line) { lines.push_back(line); });
  CHECK(lines == std::vector<std::string>{"rig: 1 video decoded by the CPU",
                                          "rig: 2 videos decoded by the CPU (camera b, c: no)"});
}

TEST_CASE("H.264 without colour is recognised by its parameters") {
  using Bytes = std::vector<std::uint8_t>;
  // A set with the number 0 and a chroma format: 1, or 010 for 4:2:0 and 011 for 4:2:2.
  constexpr std::uint8_t kGrey = 0xc0, k420 = 0xa0, k422 = 0xb0;
  const auto set = [](std::uint8_t profile, std::uint8_t format) {
    return Bytes{0x67, profile, 0, 30, format, 0x12};
  };
  const auto after = [](Bytes start, const Bytes& end) {
    start.insert(start.end(), end.begin(), end.end());
    return start;
  };
  const Bytes container = {1, 100, 0, 30, 0xff, 0xe1, 0, 6};
  const Bytes stream = {0,    0, 0, 1, 9,
                        0x10, 0, 0, 0, 1};  // another unit, then the start of the set
  for (const Bytes& start : {container, stream}) {
    CHECK(is_grey_h264(after(start, set(100, kGrey))));
    CHECK(!is_grey_h264(after(start, set(100, k420))));
    CHECK(!is_grey_h264(after(start, set(122, k422))));
    CHECK(!is_grey_h264(after(start, set(66, kGrey))));  // a profile that always has colour
    CHECK(!is_grey_h264(start));
  }
  CHECK(!is_grey_h264({}));
}

TEST_CASE("H.264 without colour is recognised by parameters within packets") {
  using Bytes = std::vector<std::uint8_t>;
  const Bytes of_container = {1, 100, 0, 30, 0xff, 0xe0};  // avcC without a set, lengths of 4 bytes
  const Bytes with_lengths = {0, 0, 0, 2, 9, 0x10, 0, 0, 0, 6, 0x67, 100, 0, 30, 0xc0, 0x12};
  const Bytes with_starts = {0, 0, 1, 9, 0x10, 0, 0, 1, 0x67, 100, 0, 30, 0xc0, 0x12};
  CHECK(is_grey_h264_packet(of_container, with_lengths));
  CHECK(!is_grey_h264_packet(of_container, with_starts));
  CHECK(is_grey_h264_packet({}, with_starts));
  CHECK(!is_grey_h264_packet({}, {}));
  Bytes colour = with_lengths;
  colour[14] = 0xa0;
  CHECK(!is_grey_h264_packet(of_container, colour));
  const Bytes beyond = {0xff, 0xff, 0xff, 0xff, 0x67};  // a length beyond the end
  CHECK(!is_grey_h264_packet(of_container, beyond));
}

}  // namespace stgs::encoder::capture_test
