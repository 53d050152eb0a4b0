// SPDX-License-Identifier: Apache-2.0
// Images: the kinds and sizes that headers state, and decoding of PNG and JPEG without OpenCV. The
// first byte of an input is the extension of the file.
#include "../fixtures/stb_write.h"
#include "../fixtures/video_tables.h"
#include "capture/file_kind.h"
#include "capture/matroska_tracks.h"
#include "capture/mov_samples.h"
#include "capture/png_text.h"
#include "captures.h"
#include "png_file.h"
#include "stgs/encoder/image_file.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr const char* kPaths[] = {"a.png", "a.jpg", "a.bmp", "a.tif", "a.webp", "a.mp4", "a"};
constexpr std::int64_t kFewPixels = 1 << 16;  // of an image that is decoded

Bytes input_of(std::uint8_t extension, const std::string& content) {
  Bytes out = {extension};
  out.insert(out.end(), content.begin(), content.end());
  return out;
}

std::string jpeg(int width, int height, int channels) {
  std::string pixels;
  for (int i = 0; i < width * height * channels; ++i) pixels += static_cast<char>(i * 7);
  std::string out;
  const auto append = [](void* to, void* bytes, int size) {
    static_cast<std::string*>(to)->append(static_cast<const char*>(bytes),
                                          static_cast<std::size_t>(size));
  };
  stbi_write_jpg_to_func(append, &out, width, height, channels, pixels.data(), 80);
  return out;
}

// A directory with the entries that state the size.
std::string tiff() {
  std::string out("II*\0\x8\0\0\0\x2\0", 10);
  for (const std::uint16_t tag : {std::uint16_t{256}, std::uint16_t{257}}) {
    append_value(out, tag);
    append_value(out, std::uint16_t{3});
    append_value(out, std::uint32_t{1});
    append_value(out, std::uint32_t{7});
  }
  return out + std::string(4, '\0');
}

std::string webp(const std::string& kind) {
  return std::string("RIFF\x20\0\0\0WEBP", 12) + kind +
         std::string("\x10\0\0\0\x2f\x5\0\1\0\5", 10) + std::string(16, '\1');
}

std::vector<Bytes> seeds() {
  return {input_of(0, tiny_png(5, 4, 3)),
          input_of(0, tiny_png(3, 7, 1)),
          input_of(1, jpeg(16, 9, 3)),
          input_of(1, jpeg(8, 8, 1)),
          input_of(2, tiny_bmp(8, 6, 9)),
          input_of(3, tiff()),
          input_of(4, webp("VP8 ")),
          input_of(4, webp("VP8L")),
          input_of(4, webp("VP8X")),
          input_of(5, std::string("\0\0\0\x14"
                                  "ftypisom",
                                  12)),
          input_of(5, "\x1a\x45\xdf\xa3\x42\x82\x88matroska"),
          input_of(5, mp4_file(mp4_sizes(0, 30), mp4_edits(2))),
          input_of(5, matroska_file(ebml(0x6240, ebml(0x5034, ebml(0x4254, "\3"))))),
          input_of(0, "\x89PNG\r\n\x1a\n" + png_chunk("zTXt", "key") + png_chunk("IEND", "")),
          input_of(5, std::string("RIFF\x20\0\0\0AVI LIST", 16))};
}

std::vector<Unit> units(View input) {
  if (input.empty()) return {};
  std::vector<Unit> out = png_units(input.subspan(1));
  for (Unit& unit : out) unit = {unit.begin + 1, unit.end + 1};
  if (out.empty()) out.push_back({1, input.size()});
  return out;
}

Bytes repair(Bytes input, Repair repair) {
  if (input.empty()) return input;
  Bytes file = repair_png(Bytes(input.begin() + 1, input.end()), repair);
  file.insert(file.begin(), input[0]);
  return file;
}

// An image of the decoder, and its copy. The decoder itself allocates with malloc().
std::uint64_t memory(View input) {
  return 8 * input.size() + 4 * static_cast<std::uint64_t>(kFewPixels) + (256 << 10);
}

// Returns the number of pixels that a PNG or JPEG header states; 0 if it is not at its place.
std::int64_t stated_pixels(View file) {
  const auto number = [&](std::size_t at, int bytes) {
    std::int64_t value = 0;
    for (int i = 0; i < bytes; ++i) value = value << 8 | file[at + static_cast<std::size_t>(i)];
    return value;
  };
  if (file.size() >= 24 && file[0] == 0x89) {
    return std::min<std::int64_t>(number(16, 4), 1 << 20) *
           std::min<std::int64_t>(number(20, 4), 1 << 20);
  }
  std::int64_t most =
      0;  // any marker of a frame, because the decoder may find another than the first
  for (std::size_t at = 0; at + 9 <= file.size(); ++at) {
    if (file[at] != 0xff || (file[at + 1] & 0xf0) != 0xc0) continue;
    most = std::max(most, number(at + 5, 2) * number(at + 7, 2));
  }
  return most;
}

}  // namespace

const Target stgs::fuzz::kTarget{"image_file", seeds, nullptr, repair, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string path = kPaths[data[0] % std::size(kPaths)];
  const Bytes file(data + 1, data + size);
  const Status kind = check_image_kind(file, path, "the image");
  check_error(kind);
  check_error(check_video_kind(View(file).first(std::min(file.size(), kVideoProbeBytes)), path,
                               "the video"));
  const auto source = memory_source(file, path);
  check_error(check_mov_samples(*source, file.size()));
  check_error(check_matroska_tracks(*source));
  Bytes image_only = file;
  remove_png_text(image_only);
  require(image_only.size() <= file.size(), "removing texts adds nothing");
  (void)has_long_png_text(file);
  const bool truncated = is_truncated_jpeg(file);
  if (stated_pixels(file) > kFewPixels) return 0;
  for (const int channels : {1, 3}) {
    const auto image = decode_image8(file, channels, path);
    check_error(image.status());
    require(is_printable(image.status().message()), "a message is text");
    if (!image.ok()) continue;
    require(!truncated, "a truncated image is not decoded");
    require(image->channels == channels &&
                image->data.size() == static_cast<std::size_t>(image->width) *
                                          static_cast<std::size_t>(image->height) *
                                          static_cast<std::size_t>(channels),
            "an image has all its pixels");
    require(check_image_size(image->width, image->height, path).ok(), "the size is allowed");
  }
  return 0;
}
