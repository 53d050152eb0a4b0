// SPDX-License-Identifier: Apache-2.0
// Small files that state much: imports stay within the memory limit.
#include <zlib.h>
#include <zstd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "fixtures/fourdgs_fixture.h"
#include "fixtures/splatv_fixture.h"
#include "fixtures/temporary_folder.h"
#include "import_bombs.h"
#include "stgs/format/fourdgs.h"
#include "stgs/format/interchange.h"
#include "stgs/format/ply_sequence.h"
#include "stgs/format/splatv.h"

namespace stgs {
namespace {

using testing::kBombLimits;
using testing::refusal;
using testing::refusal_of;
using testing::fourdgs::Fields;

std::string gzip(const std::string& raw) {
  z_stream stream{};
  REQUIRE(deflateInit2(&stream, 6, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) == Z_OK);
  std::string out(deflateBound(&stream, raw.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(raw.data()));
  stream.avail_in = static_cast<uInt>(raw.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  REQUIRE(deflate(&stream, Z_FINISH) == Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

std::string zstd(const std::string& raw) {
  std::string out(ZSTD_compressBound(raw.size()), '\0');
  const std::size_t size = ZSTD_compress(out.data(), out.size(), raw.data(), raw.size(), 1);
  REQUIRE(!ZSTD_isError(size));
  out.resize(size);
  return out;
}

// SPZ with SH of degree 3: 65 bytes stored and 260 in memory.
constexpr std::uint32_t kSpzPrimitives = 258'000;

std::string spz_header(std::uint32_t version, int streams) {
  return Fields()
      .raw("NGSP")
      .u32(version)
      .u32(kSpzPrimitives)
      .u8(3)
      .u8(12)
      .u8(0)
      .u8(static_cast<std::uint64_t>(streams))
      .text;
}

Result<Scene> import_spz(const ByteSource& source) {
  return read_spz(source, kBombLimits);
}

// A binary PLY whose values are bytes, and whose first rotation has length 0 if `drops` is set.
std::string byte_ply(std::size_t vertices, bool drops) {
  std::string out =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(vertices) + "\n";
  for (const char* name : {"x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
                           "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1", "f_dc_2"}) {
    out += std::string("property char ") + name + "\n";
  }
  out += "end_header\n";
  const std::size_t first = out.size();
  for (std::size_t i = 0; i < vertices; ++i) out += std::string(14, 1);
  if (drops) std::fill_n(out.begin() + static_cast<std::ptrdiff_t>(first) + 6, 4, '\0');
  return out;
}

// A stream of 4dgs in which all Gaussians have the same values.
std::string constant_stream(int attribute, std::size_t channels, std::size_t count, int value = 0) {
  return Fields()
      .u8(static_cast<std::uint64_t>(attribute))
      .u8(1)
      .u8(testing::fourdgs::kConstant)
      .u8(testing::fourdgs::kDeflate)
      .u8(channels)
      .u32(count)
      .blob(testing::fourdgs::stored_zlib(std::string(channels, static_cast<char>(2 * value))))
      .text;
}

std::string constant_streams(std::size_t count) {
  std::string out;
  for (int a = 0; a < 11; ++a) {
    const int value = a == 4 ? 10 : a == 5 ? 16 : a == 9 ? 1 : 0;
    out +=
        constant_stream(a, testing::fourdgs::kChannels[static_cast<std::size_t>(a)], count, value);
  }
  return out;
}

Result<Scene> import_4dgs(const ByteSource& source) {
  return read_4dgs(source, {}, kBombLimits);
}

constexpr std::size_t kGaussians = 800'000;  // 80 bytes each

}  // namespace

TEST_CASE("arrays of SPZ files count beside the primitives") {
  const std::string arrays(65 * std::size_t{kSpzPrimitives}, '\0');
  CHECK(refusal_of(gzip(spz_header(3, 0) + arrays), import_spz).find("memory limit") !=
        std::string::npos);
  std::string toc, frames;
  for (const std::size_t stride : {9, 1, 3, 3, 4, 45}) {
    const std::string frame = zstd(std::string(stride * kSpzPrimitives, '\0'));
    toc += Fields().u64(frame.size()).u64(stride * kSpzPrimitives).text;
    frames += frame;
  }
  const std::string head = Fields().raw(spz_header(4, 6)).u32(32).raw(std::string(12, '\0')).text;
  CHECK(refusal_of(head + toc + frames, import_spz).find("memory limit") != std::string::npos);
}

TEST_CASE("unknown SPZ extensions are summarised") {
  std::string extensions;
  for (std::uint32_t i = 0; i < 2'000'000; ++i) extensions += Fields().u32(i + 1).u32(0).text;
  const std::string head = Fields()
                               .raw("NGSP")
                               .u32(4)
                               .u32(0)
                               .u8(0)
                               .u8(12)
                               .u8(2)
                               .u8(0)
                               .u32(32 + extensions.size())
                               .raw(std::string(12, '\0'))
                               .raw(extensions)
                               .text;
  const auto source = memory_source({head.begin(), head.end()}, "bomb");
  fuzz::limit_heap(std::uint64_t{1} << 40);
  ConversionNotes notes;
  const Result<Scene> scene = read_spz(*source, kBombLimits, &notes);
  CHECK(fuzz::heap_peak() <= head.size() + testing::kBombMiB);
  CHECK(scene.ok());
  CHECK(notes.size() == 9);
}

TEST_CASE("dropping PLY vertices copies nothing") {
  const std::string file = byte_ply(830'000, true);
  const auto source = memory_source({file.begin(), file.end()}, "bytes.ply");
  fuzz::limit_heap(std::uint64_t{1} << 40);
  ConversionNotes notes;
  const Result<Scene> scene = read_ply(*source, {200'000'000, 80 << 20}, &notes);
  const std::uint64_t peak = fuzz::heap_peak();
  INFO("peak " << peak << ": " << scene.status().message());
  CHECK(peak <= 96 << 20);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() == 829'999);
  CHECK(notes.size() == 1);
}

TEST_CASE("the text of an ASCII PLY counts beside the vertices") {
  std::string file = "ply\nformat ascii 1.0\nelement vertex 700000\n";
  for (const char* name : {"x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
                           "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1", "f_dc_2"}) {
    file += std::string("property float ") + name + "\n";
  }
  file += "end_header\n";
  for (int i = 0; i < 700'000; ++i) file += "1 2 3 1 2 3 1 0 0 0 1 1 1 1\n";
  const std::string message =
      refusal_of(file, [](const ByteSource& source) { return read_ply(source, kBombLimits); });
  CHECK(message.find("memory limit") != std::string::npos);
}

TEST_CASE("frames of a PLY sequence count together") {
  const testing::TemporaryFolder folder;
  std::uint64_t bytes = 0;
  for (int i = 0; i < 3; ++i) {
    const std::string file = byte_ply(400'000, false);
    std::ofstream(folder / ("0" + std::to_string(i) + ".ply"), std::ios::binary) << file;
    bytes = std::max<std::uint64_t>(bytes, file.size());
  }
  CHECK(refusal(bytes, [&] {
          return read_ply_sequence(folder.path, {}, kBombLimits, nullptr, nullptr);
        }).find("memory limit") != std::string::npos);
}

TEST_CASE("JSON of a splatv file counts with the memory that its values take") {
  std::string json = "[[]";
  while (json.size() < (8 << 20)) json += ",[]";
  json += "]";
  refusal_of(testing::splatv_file({}, json),
             [](const ByteSource& source) { return read_splatv(source, {}, kBombLimits); });
}

TEST_CASE("constant streams of a .4dgs file count beside the primitives") {
  testing::fourdgs::File file;
  file.gaussians = kGaussians;
  file.body = testing::fourdgs::chunk(0, 2, kGaussians, constant_streams(kGaussians));
  CHECK(refusal_of(file.bytes(), import_4dgs).find("memory limit") != std::string::npos);
}

TEST_CASE("planes and SH of a .4dgs file count beside the primitives") {
  constexpr std::size_t kCount = 250'000;  // 260 bytes each
  testing::fourdgs::File file;
  file.gaussians = kCount;
  file.sh_degree = 3;
  file.body = testing::fourdgs::chunk(0, 2, kCount, constant_streams(kCount));
  for (int band = 1; band <= 3; ++band) {
    const std::size_t channels = 3 * (2 * static_cast<std::size_t>(band) + 1);
    file.body += testing::fourdgs::record(7, Fields()
                                                 .u8(static_cast<std::uint64_t>(band))
                                                 .u8(7)
                                                 .u8(1)
                                                 .u8(testing::fourdgs::kRaw)
                                                 .u8(testing::fourdgs::kZstd)
                                                 .u8(channels)
                                                 .u32(kCount)
                                                 .blob(zstd(std::string(channels * kCount, '\0')))
                                                 .text);
  }
  CHECK(refusal_of(file.bytes(), import_4dgs).find("memory limit") != std::string::npos);
}

TEST_CASE("states of a .4dgs file with keyframes count beside the primitives") {
  testing::fourdgs::File file;
  file.model = "keyframe-delta";
  const std::string streams = constant_streams(kGaussians) + [] {
    std::string ids;
    for (int j = 0; j < 4; ++j) {
      for (std::size_t i = 0; i < kGaussians; ++i) ids += static_cast<char>(2 * i >> (8 * j));
    }
    return Fields()
        .u8(13)
        .u8(4)
        .u8(0)
        .u8(testing::fourdgs::kZstd)
        .u8(1)
        .u32(kGaussians)
        .blob(zstd(ids))
        .text;
  }();
  file.body = testing::fourdgs::chunk(0, 2, kGaussians, streams);
  CHECK(refusal_of(file.bytes(), import_4dgs).find("memory limit") != std::string::npos);
}

TEST_CASE("records and metadata of a .4dgs file count") {
  testing::fourdgs::File file;
  file.body = testing::fourdgs::chunk(0, 2, 0, "");
  for (int i = 0; i < 2'000'000; ++i) file.body += testing::fourdgs::record(7, "");
  CHECK(refusal_of(file.bytes(), import_4dgs).find("memory limit") != std::string::npos);
  file.body = testing::fourdgs::chunk(0, 2, 0, "");
  Fields entries;
  for (std::uint32_t i = 0; i < 2'000'000; ++i) entries.u32(4).u32(i).u32(0);
  file.extra = testing::fourdgs::record(0x0B, Fields().string("").string(entries.text).text);
  CHECK(refusal_of(file.bytes(), import_4dgs).find("memory limit") != std::string::npos);
}

}  // namespace stgs
