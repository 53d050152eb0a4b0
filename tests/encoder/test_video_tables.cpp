// SPDX-License-Identifier: Apache-2.0
// Checks that run before FFmpeg or libpng could expand a small file.
#include "capture_fixture.h"
#include "catch.h"
#include "fixtures/video_tables.h"
#include "src/capture/file_window.h"
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

const std::vector<std::string> kTooMany = {"more samples than its bytes can hold"};

TEST_CASE("the tables of an MP4 file state no more samples than its bytes can hold") {
  CHECK(mov(mp4_file(mp4_sizes(0, 30))).ok());
  CHECK(mov(mp4_file(mp4_sizes(1, 250'000))).ok());
  CHECK(mov(mp4_file(mp4_sizes(100, 60'000), mp4_edits(2))).ok());
  CHECK(fails_with(mov(mp4_file(mp4_sizes(100, 70'000))), kTooMany));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(1, 85'000'000))), kTooMany));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(100, 40'000) + mp4_sizes(100, 40'000))), kTooMany));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(100, 60'000), mp4_edits(5))), kTooMany));
  CHECK(fails_with(mov(mp4_file(mp4_sizes(0xFFFFFFFF, 0xFFFFFFFF))), kTooMany));
  CHECK(fails_with(
      mov(mp4_file("") + mp4_box("moof", mp4_box("traf", mp4_table("trun", 50'000'000, "")))),
      kTooMany));
  // Sound of one chunk after the other, and offsets and groups that count samples.
  const auto chunks = [](std::uint32_t samples, std::uint32_t next) {
    return mp4_table("stco", 40, std::string(160, '\1')) +
           mp4_table("stsc", 2,
                     big_endian(1, 4) + big_endian(samples, 4) + big_endian(1, 4) +
                         big_endian(next, 4) + big_endian(1, 4) + big_endian(1, 4));
  };
  CHECK(mov(mp4_file(chunks(48'000, 40))).ok());
  CHECK(fails_with(mov(mp4_file(chunks(1u << 31, 40))), kTooMany));
  CHECK(fails_with(mov(mp4_file(chunks(1024, 1))), {"table of chunks"}));
  const std::string many = big_endian(0x7FFFFFFF, 4) + big_endian(0, 4);
  CHECK(fails_with(mov(mp4_file(mp4_table("ctts", 1, many))), kTooMany));
  CHECK(fails_with(mov(mp4_file(mp4_box("sbgp", std::string(8, '\0') + big_endian(1, 4) + many))),
                   kTooMany));
  std::string tracks, fragments;
  for (int i = 0; i < 300; ++i) tracks += mp4_box("trak", ""), fragments += mp4_box("moof", "");
  CHECK(mov(mp4_box("moov", tracks)).ok());
  CHECK(fails_with(mov(mp4_box("moov", tracks) + fragments), kTooMany));
}

TEST_CASE("tables of an MP4 file end with their box") {
  for (const char* kind : {"stts", "ctts", "stss", "stps", "stco", "co64", "stsc", "elst"}) {
    INFO(kind);
    CHECK(mov(mp4_file(mp4_table(kind, 1, std::string(12, '\0')))).ok());
    CHECK(fails_with(mov(mp4_file(mp4_table(kind, 1000, std::string(12, '\0')))),
                     {"longer than its box"}));
  }
  CHECK(
      fails_with(mov(mp4_file(mp4_sizes(0, 30).replace(18, 2, "\7\7"))), {"longer than its box"}));
  const auto description = [](std::uint32_t bytes) {
    return mp4_table("stsd", 1, big_endian(bytes, 4) + std::string(82, 'x'));
  };
  CHECK(mov(mp4_file(description(86))).ok());
  CHECK(fails_with(mov(mp4_file(description(87))), {"damaged description"}));
}

TEST_CASE("tables of an MP4 file are found where FFmpeg finds them") {
  const std::string sizes = mp4_sizes(100, 70'000), file = mp4_file(mp4_sizes(0, 30));
  CHECK(fails_with(mov(mp4_file(mp4_box("stsd", std::string(70'000, 'x') + sizes))),
                   {"tables in a description"}));
  CHECK(fails_with(mov(mp4_box("free", mp4_box("mvhd", "") + sizes) + file), kTooMany));
  const std::string title = mp4_box("ilst", "Edelstahl, trunk");
  const auto metadata = [](const std::string& content) {
    return mp4_box("udta",
                   mp4_box("meta", std::string(4, '\0') + mp4_box("hdlr", "mdir") + content));
  };
  CHECK(mov(file + metadata(title)).ok());
  CHECK(fails_with(mov(file + metadata(sizes)), kTooMany));
  CHECK(fails_with(mov(file + mp4_box("moov", mp4_box("cmov", ""))), {"compressed"}));
  CHECK(
      fails_with(mov(file + mp4_box("moof", mp4_box("traf", mp4_box("senc", "")))), {"encrypted"}));
  std::string nested = sizes;
  for (int i = 0; i < 12; ++i) nested = mp4_box("udta", nested);
  CHECK(fails_with(mov(file + nested), {"too deep"}));
  // Sizes of 64 bits, to the end of the file, and invalid ones, which end the boxes.
  for (const std::string& head :
       {big_endian(1, 4) + "moov" + big_endian(16 + 4000, 8),
        big_endian(1, 4) + "moov" + big_endian(8, 8), big_endian(0, 4) + std::string("moov")})
    CHECK(fails_with(mov(head + mp4_box("stbl", sizes)), kTooMany));
  CHECK(mov(file + big_endian(7, 4) + "trailer").ok());
  for (std::size_t size = 0; size < file.size(); ++size) {
    const Status status = mov(file.substr(0, size));
    CHECK((status.ok() || status.code() == StatusCode::kInvalidFile));
  }
}

// A file whose reads fail after the first window.
class FailingSource final : public ByteSource {
 public:
  explicit FailingSource(const std::string& text) : source_(source_of(text)) {}
  std::uint64_t size() const override { return source_->size(); }
  const std::string& name() const override { return source_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return offset < FileWindow::kBytes ? source_->read(offset, out) : io_error("read failed");
  }

 private:
  std::unique_ptr<ByteSource> source_;
};

TEST_CASE("a failed read of a table is an error") {
  // The content of the table begins at the second window.
  const FailingSource file(mp4_box("skip", std::string(FileWindow::kBytes - 16, 'x')) +
                           mp4_table("stts", 1, std::string(8, '\1')));
  CHECK(check_mov_samples(file, file.size()).code() == StatusCode::kIo);
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
