// SPDX-License-Identifier: Apache-2.0
// The decoders of the import module (sdk/web/core/unpack) against zlib, libzstd, libwebp and
// libzip.
#include <webp/decode.h>
#include <webp/encode.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <fstream>
#include <random>

#include "catch.h"
#include "fixtures/sog_fixture.h"
#include "fixtures/temporary_folder.h"
#include "unpack/inflate.h"
#include "unpack/webp.h"
#include "unpack/zstd.h"
#include "zip_members.h"

using namespace stgs;
using Bytes = std::vector<std::uint8_t>;

namespace {

// Content of several kinds: noise, repetitions near and far, long runs, few symbols.
std::vector<Bytes> contents() {
  std::mt19937 random(5);
  const auto made_of = [&](std::size_t size, unsigned symbols) {
    Bytes out(size);
    for (auto& byte : out) byte = static_cast<std::uint8_t>(random() % symbols * 7);
    return out;
  };
  std::vector<Bytes> all = {{},
                            {1},
                            Bytes(100'000, 9),
                            made_of(40, 256),
                            made_of(3000, 3),
                            made_of(70'000, 256),
                            made_of(300'000, 20)};
  Bytes mixed;
  while (mixed.size() < 700'000) {
    const std::size_t length = 1 + random() % 400;
    if (mixed.size() > length && random() % 3 != 0) {
      const std::size_t from = random() % (mixed.size() - length);
      for (std::size_t i = 0; i < length; ++i) mixed.push_back(mixed[from + i]);
    } else {
      for (std::size_t i = 0; i < length; ++i) {
        mixed.push_back(static_cast<std::uint8_t>(random() & random()));
      }
    }
  }
  all.push_back(mixed);
  Bytes skewed(200'000);  // codes of very different lengths
  for (auto& byte : skewed) {
    byte = static_cast<std::uint8_t>(std::countr_zero(random() | 0x80000000u) * 5);
  }
  all.push_back(skewed);
  return all;
}

Bytes deflated(const Bytes& content, int level, int strategy) {
  z_stream stream{};
  deflateInit2(&stream, level, Z_DEFLATED, -MAX_WBITS, 8, strategy);
  Bytes out(deflateBound(&stream, content.size()) + 32);
  stream.next_in = const_cast<Bytef*>(content.data());
  stream.avail_in = static_cast<uInt>(content.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

Bytes compressed(const Bytes& content, int level, bool has_checksum) {
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, has_checksum ? 1 : 0);
  Bytes out(ZSTD_compressBound(content.size()));
  out.resize(ZSTD_compress2(context, out.data(), out.size(), content.data(), content.size()));
  ZSTD_freeCCtx(context);
  return out;
}

// Calls check(damaged) for copies of the bytes with changed, missing and additional bytes.
template <typename Check>
void with_damage(const Bytes& bytes, int copies, const Check& check) {
  std::mt19937 random(17);
  for (int i = 0; i < copies; ++i) {
    Bytes copy = bytes;
    for (auto changes = 1 + random() % 3; changes > 0; --changes) {
      copy[random() % copy.size()] ^= static_cast<std::uint8_t>(1u << random() % 8);
    }
    if (i % 4 == 3) copy.resize(random() % copy.size());
    check(copy);
  }
}

testing::RgbaImage image_of(int width, int height, unsigned kind) {
  std::mt19937 random(kind);
  testing::RgbaImage image{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto noise = static_cast<unsigned>(random());
      for (unsigned c = 0; c < 4; ++c) {
        unsigned value = noise >> 8 * c;                                          // noise
        if (kind % 6 == 1) value = unsigned(x * 3 + y * 2) + c * 20 + noise % 3;  // gradients
        if (kind % 6 == 2) value = (x / 9 + y / 7) % 2 * 90 + c;                  // few colours
        if (kind % 6 == 3) value = (noise % 13) * (c + 5);                        // a palette
        if (kind % 6 == 4) value = c == 3 ? 255 : unsigned((x * x + y * y) / 40);
        if (kind % 6 == 5) value = 77;
        image.rgba.push_back(static_cast<std::uint8_t>(value));
      }
    }
  }
  return image;
}

// Encodes with an effort of 0 to 9 and a quality of 0 to 100, which select the tools of the format.
std::string webp_of(const testing::RgbaImage& image, int effort, int quality) {
  WebPConfig config;
  WebPConfigInit(&config);
  WebPConfigLosslessPreset(&config, effort);
  config.quality = static_cast<float>(quality);
  config.exact = 1;
  return testing::encode_webp(image, config);
}

constexpr std::size_t kWebpHeaders = 12 + 8 + 5;  // of the file, the chunk, and the stream

}  // namespace

TEST_CASE("inflate returns what was deflated, in pieces of any size") {
  for (const Bytes& content : contents()) {
    for (const auto& [level, strategy] : {std::pair{0, Z_DEFAULT_STRATEGY},
                                          {1, Z_DEFAULT_STRATEGY},
                                          {9, Z_DEFAULT_STRATEGY},
                                          {9, Z_FIXED},
                                          {6, Z_HUFFMAN_ONLY}}) {
      const Bytes stream = deflated(content, level, strategy);
      web::Inflate inflate(stream);
      Bytes out(content.size() + 1);
      std::size_t done = 0;
      for (std::size_t piece = 1; done < content.size(); piece = piece * 3 + 1) {
        const auto got =
            inflate.read(std::span(out).subspan(done, std::min(piece, out.size() - done)));
        REQUIRE(got);
        done += *got;
        if (*got == 0) break;
      }
      REQUIRE(done == content.size());
      REQUIRE(inflate.read(std::span(out).last(1)) == std::size_t{0});
      CHECK(inflate.position() == stream.size());
      out.resize(done);
      CHECK(out == content);
      if (!stream.empty()) {
        const Bytes less(stream.begin(), stream.end() - 1);
        web::Inflate cut(less);
        Bytes all(content.size() + 1);
        CHECK_FALSE(cut.read(all));
      }
    }
  }
}

TEST_CASE("inflate accepts the damaged streams that zlib accepts") {
  const Bytes content = contents()[4];
  int accepted = 0;
  with_damage(deflated(content, 9, Z_DEFAULT_STRATEGY), 400, [&](const Bytes& stream) {
    Bytes expected(content.size() + 4000), got(content.size() + 4000);
    z_stream zlib{};
    inflateInit2(&zlib, -MAX_WBITS);
    zlib.next_in = const_cast<Bytef*>(stream.data());
    zlib.avail_in = static_cast<uInt>(stream.size());
    zlib.next_out = expected.data();
    zlib.avail_out = static_cast<uInt>(expected.size());
    const int code = inflate(&zlib, Z_NO_FLUSH);
    const std::size_t size = zlib.total_out;
    inflateEnd(&zlib);
    const auto done = web::Inflate(stream).read(got);
    const bool is_valid = code == Z_STREAM_END || (code == Z_OK && size == expected.size());
    REQUIRE(done.has_value() == is_valid);
    if (!is_valid) return;
    ++accepted;
    CHECK(*done == size);
    CHECK(got == expected);
  });
  CHECK(accepted > 0);
}

TEST_CASE("zstd returns what was compressed") {
  for (const Bytes& content : contents()) {
    for (const int level : {-5, 1, 3, 9, 19}) {
      const Bytes frame = compressed(content, level, level % 2 != 0);
      Bytes out(content.size());
      INFO(content.size() << " bytes, level " << level);
      const char* const problem = web::decode_zstd(frame, out);
      REQUIRE((problem == nullptr ? std::string() : std::string(problem)) == "");
      CHECK(out == content);
      if (content.empty()) continue;
      Bytes less(content.size() - 1), more(content.size() + 1);
      CHECK(web::decode_zstd(frame, less) != nullptr);
      CHECK(web::decode_zstd(frame, more) != nullptr);
      CHECK(web::decode_zstd(std::span(frame).first(frame.size() - 1), out) != nullptr);
    }
  }
}

TEST_CASE("zstd decodes several frames, and skips those of other content") {
  const Bytes first = contents()[3], second = contents()[4];
  Bytes frames = compressed(first, 3, true);
  for (const int byte : {0x5F, 0x2A, 0x4D, 0x18, 3, 0, 0, 0, 1, 2, 3}) {
    frames.push_back(static_cast<std::uint8_t>(byte));
  }
  const Bytes more = compressed(second, 3, false);
  frames.insert(frames.end(), more.begin(), more.end());
  Bytes expected = first, out(first.size() + second.size());
  expected.insert(expected.end(), second.begin(), second.end());
  CHECK(web::decode_zstd(frames, out) == nullptr);
  CHECK(out == expected);
}

TEST_CASE("zstd returns what libzstd returns for damaged frames") {
  for (const std::size_t kind : {4, 8}) {
    const Bytes content = contents()[kind];
    int accepted = 0;
    with_damage(compressed(content, 5, false), 300, [&](const Bytes& frame) {
      Bytes expected(content.size()), got(content.size());
      const std::size_t size =
          ZSTD_decompress(expected.data(), expected.size(), frame.data(), frame.size());
      if (web::decode_zstd(frame, got) != nullptr) return;
      // libzstd rejects some frames that RFC 8878 leaves open, and never decodes others.
      if (ZSTD_isError(size) || size != expected.size()) return;
      ++accepted;
      CHECK(got == expected);
    });
    CHECK(accepted > 0);
  }
}

TEST_CASE("webp returns the pixels that were encoded") {
  for (unsigned kind = 0; kind < 6; ++kind) {
    for (const auto& [width, height] : {std::pair{1, 1}, {1, 40}, {53, 1}, {7, 5}, {130, 97}}) {
      for (const auto& [effort, quality] : {std::pair{0, 0}, {4, 50}, {9, 100}}) {
        INFO("kind " << kind << ", " << width << " x " << height << ", effort " << effort);
        const testing::RgbaImage image = image_of(width, height, kind);
        const std::string file = webp_of(image, effort, quality);
        const Bytes bytes(file.begin(), file.end());
        REQUIRE(file.substr(12, 4) == "VP8L");
        Bytes out(image.rgba.size());
        REQUIRE(web::decode_vp8l(std::span(bytes).subspan(kWebpHeaders),
                                 static_cast<std::uint32_t>(width),
                                 static_cast<std::uint32_t>(height), out));
        CHECK(out == image.rgba);
      }
    }
  }
}

TEST_CASE("webp returns the pixels that libwebp returns for damaged images") {
  int accepted = 0;
  for (unsigned kind = 0; kind < 6; ++kind) {
    const std::string file = webp_of(image_of(60, 41, kind), 6, 75);
    const Bytes stream(file.begin() + kWebpHeaders, file.end());
    with_damage(stream, 150, [&](const Bytes& damaged) {
      Bytes got(60 * 41 * 4), expected(got.size()),
          whole(file.begin(), file.begin() + kWebpHeaders);
      whole.insert(whole.end(), damaged.begin(), damaged.end());
      const bool is_accepted = web::decode_vp8l(damaged, 60, 41, got);
      whole.resize(file.size());
      const auto* const pixels =
          WebPDecodeRGBAInto(whole.data(), whole.size(), expected.data(), expected.size(), 60 * 4);
      if (!is_accepted || pixels == nullptr) return;
      ++accepted;
      CHECK(got == expected);
    });
  }
  CHECK(accepted > 20);
}

TEST_CASE("zip returns the members that libzip wrote, and rejects damage") {
  const testing::TemporaryFolder folder;
  const testing::SogModel model = testing::random_sog(300, 1, 9);
  model.write_bundle(folder / "model.sog");
  std::ifstream file(folder / "model.sog", std::ios::binary);
  const Bytes archive{std::istreambuf_iterator<char>(file), {}};
  ImportMemory memory({}, "model.sog");
  {
    const auto files = web::zip_members(archive, "model.sog", memory);
    REQUIRE(files.ok());
    for (const auto& [name, content] : model.all_files()) {
      const auto bytes = (*files)->read(name, memory, ~std::uint64_t{0});
      INFO(name << ": " << bytes.status().message());
      REQUIRE(bytes.ok());
      CHECK(std::equal(content.begin(), content.end(), bytes->value.begin(), bytes->value.end(),
                       [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }));
    }
    CHECK((*files)->read("other", memory, 100).status().code() == StatusCode::kInvalidFile);
    CHECK((*files)->read("meta.json", memory, 100).status().code() == StatusCode::kUnsupported);
  }
  CHECK_FALSE(web::zip_members(std::span(archive).first(archive.size() - 1), "cut", memory).ok());
  int rejected = 0;
  with_damage(archive, 300, [&](const Bytes& damaged) {
    const auto files = web::zip_members(damaged, "damaged", memory);
    if (!files.ok()) {
      ++rejected;
      return;
    }
    for (const auto& [name, content] : model.all_files()) {
      const auto bytes = (*files)->read(name, memory, 1 << 20);
      rejected += bytes.ok() ? 0 : 1;
      if (bytes.ok()) CHECK(bytes->value.size() == content.size());
    }
  });
  CHECK(rejected > 200);
}

TEST_CASE("a zip member that states more than it can hold is rejected before it is allocated") {
  const testing::TemporaryFolder folder;
  testing::SogModel model;
  model.files["bomb"] = std::string(1 << 20, 'a');
  model.write_bundle(folder / "bomb.sog");
  std::ifstream file(folder / "bomb.sog", std::ios::binary);
  Bytes archive{std::istreambuf_iterator<char>(file), {}};
  ReadLimits limits;
  limits.max_memory = 1 << 16;
  ImportMemory memory(limits, "bomb.sog");
  const auto files = web::zip_members(archive, "bomb.sog", memory);
  REQUIRE(files.ok());
  const auto refused = (*files)->read("bomb", memory, ~std::uint64_t{0});
  CHECK(refused.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(refused.status().message(), Catch::Contains("memory limit of 65536 bytes"));
}
