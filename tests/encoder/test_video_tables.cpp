// SPDX-License-Identifier: Apache-2.0
// What a small video or image would make a decoder expand is refused or removed before.
#include "capture_fixture.h"
#include "catch.h"
#include "fixtures/video_tables.h"
#include "src/capture/matroska_tracks.h"
#include "src/capture/mov_samples.h"
#include "src/capture/png_text.h"
#include "stgs/format/byte_source.h"

namespace stgs::encoder::capture_test {
namespace {

using namespace stgs::testing;

std::unique_ptr<ByteSource> source_of(const std::string& text) {
  return memory_source({text.begin(), text.end()}, "a.mp4");
}

Status mov(const std::string& text) {
  return check_mov_samples(*source_of(text), text.size());
}

Status matroska(const std::string& text) {
  return check_matroska_tracks(*source_of(text));
}

std::vector<std::uint8_t> bytes_of_text(const std::string& text) {
  return {text.begin(), text.end()};
}

TEST_CASE("the tables of an MP4 file state no more samples than its bytes can hold") {
  CHECK(mov(mp4_file(mp4_sizes(0, 30))).ok());
  CHECK(mov(mp4_file(mp4_sizes(1, 250'000))).ok());
  CHECK(mov(mp4_file(mp4_sizes(0, 60'000), mp4_edits(2))).ok());
  const std::vector<std::string> words = {"more samples than its bytes can hold"};
  CHECK(fails_with(mov(mp4_file(mp4_sizes(0, 70'000))), words));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(1, 85'000'000))), words));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(0, 40'000) + mp4_sizes(0, 40'000))), words));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(0, 60'000), mp4_edits(5))), words));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(0xFFFFFFFF, 0xFFFFFFFF) + mp4_sizes(0xFFFFFFFF, 3))),
                   words));
  const std::string run = mp4_box("trun", big_endian(0, 4) + big_endian(50'000'000, 4));
  CHECK(fails_with(mov(mp4_file("") + mp4_box("moof", mp4_box("traf", run))), words));
}

TEST_CASE("tables of an MP4 file where only FFmpeg would find them are refused") {
  const std::string sizes = mp4_sizes(0, 30), file = mp4_file(sizes);
  CHECK(fails_with(mov(mp4_file(mp4_box("stsd", std::string(70'000, 'x') + sizes))),
                   {"tables in a description"}));
  CHECK(fails_with(mov(mp4_box("free", mp4_box("mvhd", "") + sizes) + file), {"free space"}));
  CHECK(fails_with(mov(file + mp4_box("moov", mp4_box("cmov", ""))), {"compressed"}));
  std::string nested = sizes;
  for (int i = 0; i < 12; ++i) nested = mp4_box("udta", nested);
  CHECK(fails_with(mov(file + nested), {"too deep"}));
  // A box of 64 bits, and one to the end of the file.
  CHECK(fails_with(mov(big_endian(1, 4) + "moov" + big_endian(16 + 4000, 8) +
                       mp4_box("trak", mp4_box("stbl", mp4_sizes(0, 70'000)))),
                   {"more samples"}));
  CHECK(fails_with(mov(big_endian(0, 4) + "moov" + mp4_box("stbl", mp4_sizes(0, 70'000))),
                   {"more samples"}));
  for (std::size_t size = 0; size < file.size(); ++size) {
    const Status status = mov(file.substr(0, size));
    CHECK((status.ok() || status.code() == StatusCode::kInvalidFile));
  }
}

TEST_CASE("holes of a video file count as nothing") {
  const TemporaryFolder folder;
  SourceCamera camera;
  camera.name = "cam";
  camera.video = folder / "a.mp4";
  write_bytes(camera.video, mp4_file(mp4_sizes(1, 10'000'000)));
  fs::resize_file(camera.video, 100'000'000);
  CHECK(fails_with(probe_frames(*files_of(folder), camera).status(),
                   {"a.mp4", "more samples than its bytes can hold"}));
}

TEST_CASE("compressed tracks of a Matroska file are refused") {
  const auto algorithm = [](const std::string& value) {
    return ebml(0x6240, ebml(0x5034, ebml(0x4254, value)));
  };
  CHECK(matroska(matroska_file("")).ok());
  CHECK(matroska(matroska_file(algorithm("\3"))).ok());  // equal first bytes are left out
  for (const std::string& encoding :
       {algorithm(std::string(1, '\0')), algorithm("\1"), algorithm(""), ebml(0x6240, ""),
        algorithm("\3") + ebml(0x6240, ebml(0x5034, ebml(0x4254, "\3") + ebml(0x4254, "\1"))),
        ebml(0x6240, ebml(0x5034, ebml(0x4254, "\3")) + ebml(0x5034, "")),
        ebml(0x6240, ebml(0x5034, ebml(0x4254, "\3") + ebml(0x4255, std::string(65, 'x')))),
        ebml(0x6240, ebml(0x5032, "\1") + ebml(0x5034, ""))}) {
    CHECK(fails_with(matroska(matroska_file(encoding)), {"compressed or encrypted track"}));
    // Behind other data, across the window of the search.
    for (std::size_t before = 65'500; before < 65'540; ++before)
      CHECK_FALSE(matroska(std::string(before, 'x') + matroska_file(encoding)).ok());
  }
  // Frames of subtitles, and a track behind one of unknown size.
  const std::string zlib = ebml(0x6240, ebml(0x5032, "\1") + ebml(0x5034, ""));
  CHECK(matroska(matroska_file(zlib, 0x11)).ok());
  CHECK(fails_with(matroska("\x16\x54\xAE\x6B\xFF\xAE\xFF" + ebml(0xAE, ebml(0x6D80, zlib))),
                   {"compressed or encrypted track"}));
  std::string tracks;
  for (int i = 0; i < 1001; ++i) tracks += "\xAE\x80";
  CHECK(fails_with(matroska(ebml(0x1654AE6B, tracks)), {"too many tracks"}));
  std::string tables;
  for (int i = 0; i < 3000; ++i) tables += "\xEC\x85\x16\x54\xAE\x6B\xFF";
  CHECK(fails_with(matroska(tables), {"too many tables"}));
  const std::string file = matroska_file(algorithm("\3"));
  for (std::size_t size = 0; size < file.size(); ++size)
    CHECK((matroska(file.substr(0, size)).ok() || size > 20));
}

TEST_CASE("texts of PNG images are removed, and long ones of video frames are found") {
  const std::string begin = "\x89PNG\r\n\x1a\n", header = png_chunk("IHDR", "13 bytes here");
  const std::string text = png_chunk("zTXt", "key") + png_chunk("iCCP", "profile"),
                    pixels = png_chunk("IDAT", "data") + png_chunk("IEND", "");
  std::vector<std::uint8_t> bytes = bytes_of_text(begin + header + text + pixels + text);
  remove_png_text(bytes);
  CHECK(bytes == bytes_of_text(begin + header + pixels));
  const std::vector<std::uint8_t> jpeg = bytes_of_text("\xff\xd8\xff" + text);
  std::vector<std::uint8_t> other = jpeg;
  remove_png_text(other);
  CHECK(other == jpeg);
  const std::string all = begin + header + text + pixels;
  for (std::size_t size = 0; size <= all.size(); ++size) {
    std::vector<std::uint8_t> cut = bytes_of_text(all.substr(0, size));
    remove_png_text(cut);
    CHECK(cut.size() <= size);
    CHECK_FALSE(has_long_png_text(bytes_of_text(all.substr(0, size))));
  }
  const std::string lengthy = png_chunk("zTXt", std::string(70'000, 'x'));
  CHECK(has_long_png_text(bytes_of_text(begin + header + lengthy + pixels)));
  CHECK(has_long_png_text(bytes_of_text("\x8aMNG\r\n\x1a\n" + lengthy)));
}

}  // namespace
}  // namespace stgs::encoder::capture_test
