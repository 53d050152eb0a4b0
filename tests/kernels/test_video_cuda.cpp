// SPDX-License-Identifier: Apache-2.0
// Compares videos that NVDEC decodes with the CPU. Exit code 77: no device.
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "catch_runner.h"
#include "video_cases.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

const Case kDecoded[] = {
    {"plain.mp4", {}},
    {"small.mp4", {.width = 64, .height = 48}},
    {"b_frames.mkv", {.options = "bf=3:g=12:refs=4:x264-params=b-adapt=0"}},
    {"open_gop.mp4", {.options = "g=10:bf=2:x264-params=open-gop=1"}},
    {"full.mp4", {.full_range = true}},
    {"jpeg_range.mp4", {.format = "yuvj420p"}},
    {"fields.mp4", {.height = 192, .options = "flags=+ildct+ilme:x264-params=interlaced=1"}},
    {"cropped.mp4", {.height = 182}},
    {"left.mp4", {.filter = "h264_metadata=crop_left=32:crop_top=8"}},
    {"turned.mp4", {.rotation = 90}},
    {"hevc.mp4", {.encoder = "libx265", .options = "x265-params=log-level=none"}},
    {"hevc10.mp4",
     {.encoder = "libx265", .format = "yuv420p10le", .options = "x265-params=log-level=none"}},
    {"vp9.webm", {.encoder = "libvpx-vp9", .options = "deadline=realtime:cpu-used=8"}},
    {"vp9_10.webm",
     {.encoder = "libvpx-vp9",
      .format = "yuv420p10le",
      .options = "profile=2:deadline=realtime:cpu-used=8"}},
};

const Case kRefused[] = {
    {"422.mp4", {.format = "yuv422p"}},
    {"444.mp4", {.format = "yuv444p"}},
    {"grey.mp4", {.format = "gray"}},
    {"ten.mp4", {.format = "yuv420p10le"}},
    {"part2.mp4", {.encoder = "mpeg4"}},
    {"all.avi", {.encoder = "mjpeg", .format = "yuvj420p"}},
    {"tiny.mp4", {.width = 32, .height = 16}},
    {"odd.webm",
     {.encoder = "libvpx-vp9",
      .width = 321,
      .height = 181,
      .options = "deadline=realtime:cpu-used=8"}},
    {"av1.mkv", {.encoder = "libaom-av1", .frames = 5, .options = "usage=realtime:cpu-used=8"}},
};

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

}  // namespace

TEST_CASE("NVDEC decodes the frames of the CPU") {
  const TemporaryFolder folder;
  const VideoDecoding gpu = on_gpu(true);
  for (const Case& video : kDecoded) {
    const std::string path = folder / video.name;
    INFO(video.name);
    if (!write_case(path, video.spec)) continue;
    const Decoded found = decoded(path, gpu), expected = decoded(path, {});
    INFO(found.status.message());
    CHECK(found.by.gpu);
    CHECK(!expected.by.gpu);
    CHECK(int(expected.images.size()) == video.spec.frames);
    check_same(found, expected);
  }
}

TEST_CASE("videos that NVDEC does not decode are decoded by the CPU, or refused") {
  const TemporaryFolder folder;
  for (const Case& video : kRefused) {
    const std::string path = folder / video.name;
    INFO(video.name);
    if (!write_case(path, video.spec)) continue;
    const Decoded found = decoded(path, on_gpu());
    INFO(found.by.refusal);
    CHECK(!found.by.gpu);
    CHECK(!found.by.refusal.empty());
    check_same(found, decoded(path, {}));
    const Status refused = decoded(path, on_gpu(true)).status;
    INFO(refused.message());
    CHECK(refused.code() == StatusCode::kUnsupported);
    CHECK(refused.message().find("use --video-decoder auto") != std::string::npos);
  }
}

TEST_CASE("decoders of more than a quarter of the free GPU memory are refused") {
  const TemporaryFolder folder;
  const std::string path = folder / "a.mp4";
  write_video(path, {.frames = 3});
  const VideoDecoding gpu = on_gpu();
  for (std::size_t bytes = std::size_t{1} << 40; bytes > 1000; bytes /= 2)
    while (gpu.device->reserve(bytes)) continue;
  const Decoded found = decoded(path, gpu);
  CHECK(!found.by.gpu);
  CHECK(found.by.refusal.find("a quarter of the free GPU memory") != std::string::npos);
  check_same(found, decoded(path, {}));
}

TEST_CASE("NVDEC starts with a late frame as the CPU does") {
  const TemporaryFolder folder;
  const std::string path = folder / "a.mp4";
  write_video(path, {.frames = 300, .options = "g=50:bf=3:x264-params=open-gop=0"});
  for (const int first : {257, 270, 299}) {
    INFO(first);
    std::vector<Decoded> found;
    for (const VideoDecoding& decoding : {on_gpu(true), VideoDecoding()}) {
      const auto decoder = opened(path, decoding);
      REQUIRE(decoder.ok());
      const Result<bool> skipped = (*decoder)->skip_to(first);
      REQUIRE(skipped.ok());
      CHECK(*skipped);
      found.push_back(rest_of(**decoder));
    }
    CHECK(int(found[0].images.size()) == 300 - first);
    check_same(found[0], found[1]);
  }
}

TEST_CASE("a video that is cut short ends at the same frame with the same error") {
  const TemporaryFolder folder;
  for (const Case& video :
       {Case{"a.mkv", {}},
        Case{"b.mkv", {.encoder = "libx265", .options = "x265-params=log-level=none"}},
        Case{"c.mkv", {.encoder = "libvpx-vp9", .options = "deadline=realtime"}}}) {
    const std::string path = folder / video.name;
    INFO(video.name);
    if (!write_case(path, video.spec)) continue;
    const std::string all = bytes_of(path);
    for (const double share : {0.3, 0.6, 0.9}) {
      write_bytes(path, all.substr(0, static_cast<std::size_t>(share * double(all.size()))));
      check_same(decoded(path, on_gpu(true)), decoded(path, {}));
    }
  }
}

TEST_CASE("NVDEC survives damage inside of frames") {
  const TemporaryFolder folder;
  for (const Case& video :
       {Case{"a.mkv", {}},
        Case{"b.mkv", {.encoder = "libx265", .options = "x265-params=log-level=none"}},
        Case{"c.mkv", {.encoder = "libvpx-vp9", .options = "deadline=realtime"}}}) {
    const std::string path = folder / video.name;
    if (!write_case(path, video.spec)) continue;
    const std::string all = bytes_of(path);
    for (int k = 1; k < 12; ++k) {
      INFO(video.name << " " << k);
      std::string damaged = all;
      for (int i = 0; i < 40; ++i)
        damaged[all.size() * std::size_t(k) / 12 + std::size_t(i)] ^= 0x5a;
      write_bytes(path, damaged);
      const Decoded found = decoded(path, on_gpu()), expected = decoded(path, {});
      INFO("CPU: " << expected.images.size() << " " << expected.status.message());
      INFO("GPU: " << found.images.size() << " " << found.status.message());
      const StatusCode code = found.status.code();
      CHECK((code == StatusCode::kOk || code == StatusCode::kInvalidFile));
      if (expected.status.ok()) CHECK(found.images.size() == expected.images.size());
    }
  }
}

TEST_CASE("NVDEC decodes streams through a pipe, also if they change from 8 to 10 bits") {
  const TemporaryFolder folder;
  // Without a container, so that streams can follow each other without damage.
  const VideoSpec hevc{.encoder = "libx265",
                       .options = "g=10:bf=2:x265-params=log-level=none",
                       .filter = "dump_extra"};
  VideoSpec hevc10 = hevc;
  hevc10.format = "yuv420p10le";
  const Case a{"a.ts", {.options = "g=10:bf=0", .filter = "dump_extra"}}, b{"b.hevc", hevc},
      c{"c.hevc", hevc10};
  std::string bytes[3];
  for (int k = 0; k < 3; ++k) {
    const Case& video = k == 0 ? a : k == 1 ? b : c;
    if (write_case(folder / video.name, video.spec)) bytes[k] = bytes_of(folder / video.name);
  }
  for (const std::string& sent : {bytes[0], bytes[1] + bytes[2], bytes[2] + bytes[1]}) {
    if (sent.empty()) continue;
    const std::string pipe = folder / "pipe";
    const auto stream = [&](const VideoDecoding& decoding) {
      REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
      std::thread writer([&] { write_bytes(pipe, sent); });
      const auto decoder = VideoDecoder::open_stream(
          pipe, "camera 'a'", [] { return false; }, decoding);
      INFO(decoder.status().message());
      REQUIRE(decoder.ok());
      Decoded out = rest_of(**decoder);
      writer.join();
      std::filesystem::remove(pipe);
      return out;
    };
    const Decoded found = stream(on_gpu(true)), expected = stream({});
    CHECK(found.by.gpu);
    CHECK(found.images.size() >= 30);
    check_same(found, expected);
  }
}

TEST_CASE("decoders share a device") {
  const TemporaryFolder folder;
  const std::string path = folder / "a.mp4";
  write_video(path, {.options = "bf=2"});
  const VideoDecoding gpu = on_gpu(true);
  const Decoded expected = decoded(path, {});
  std::vector<Decoded> found(12);
  std::vector<std::thread> threads;
  for (Decoded& out : found) threads.emplace_back([&] { out = decoded(path, gpu); });
  for (std::thread& thread : threads) thread.join();
  for (const Decoded& one : found) check_same(one, expected);
}
