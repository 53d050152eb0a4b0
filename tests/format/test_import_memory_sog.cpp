// SPDX-License-Identifier: Apache-2.0
// Small SOG, .sogst and .tsog models that state much: imports stay within the memory limit.
#include <fstream>

#include "fixtures/file_bytes.h"
#include "fixtures/sogst_fixture.h"
#include "fixtures/temporary_folder.h"
#include "import_bombs.h"
#include "interchange/named_files.h"
#include "stgs/format/interchange.h"
#include "stgs/format/timed_formats.h"

namespace stgs {
namespace {

using testing::kBombLimits;
using testing::refusal;
using testing::RgbaImage;
using testing::SogModel;

// An image of one colour.
RgbaImage flat(int width, int height) {
  RgbaImage image{width, height, {}};
  image.rgba.assign(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 255);
  return image;
}

template <typename Import>
std::string refusal_of(const SogModel& model, const Import& import) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "bomb.sog";
  model.write_bundle(path);
  return refusal(std::filesystem::file_size(path), [&] { return import(path); });
}

Result<Scene> import_sog(const std::string& path) {
  return read_sog(path, kBombLimits);
}

}  // namespace

TEST_CASE("images of a SOG model count together") {
  SogModel model = testing::random_sog(1, 3, 1);
  model.meta["count"] = 500'000;
  for (auto& [name, image] : model.images) image = flat(2800, 2800);
  model.images["centroids.webp"] = flat(960, 16383);
  CHECK(refusal_of(model, import_sog).find("memory limit") != std::string::npos);
}

TEST_CASE("the largest image that WebP allows is refused") {
  SogModel model = testing::random_sog(1, 0, 1);
  // A lossless header of 16383 x 16383 pixels without a body.
  std::string bytes(64, '\0');
  bytes.replace(0, 26,
                std::string("RIFF\x38\0\0\0WEBPVP8L\x2C\0\0\0\x2F\xFE\xBF\xFF\x0F", 25) + '\0');
  for (const auto& [name, image] : model.images) model.files[name] = bytes;
  CHECK(refusal_of(model, import_sog).find("image too large (16383 x 16383 pixels for 1 splats)") !=
        std::string::npos);
}

TEST_CASE("groups of splats cannot share images") {
  SogModel model = testing::streamed(testing::random_sogst(20, 0, 1, 1));
  model.meta["streams"]["segments"][2] = "seg_001";
  CHECK(refusal_of(model, [](const std::string& path) {
          return read_sogst(path, {}, kBombLimits, nullptr, nullptr);
        }).find("two groups of splats have the images in \"seg_001/\"") != std::string::npos);
}

TEST_CASE("reading from a zip archive takes time in proportion to its size") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "bomb.sog";
  SogModel model = testing::random_sog(1, 0, 1);
  SECTION("one list of members is tried") {
    model.write_bundle(path);
    std::vector<std::uint8_t> bytes = testing::bytes_of(path);
    constexpr std::size_t kEnd = 22, kEnds = 2900;  // bytes of an end record, and how many follow
    const std::vector<std::uint8_t> end(bytes.end() - kEnd, bytes.end());
    // The last field is the size of the comment.
    bytes[bytes.size() - 2] = kEnd * kEnds & 0xFF;
    bytes[bytes.size() - 1] = kEnd * kEnds >> 8;
    for (std::size_t i = 0; i < kEnds; ++i) bytes.insert(bytes.end(), end.begin(), end.end());
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    CHECK(refusal(bytes.size(), [&] { return import_sog(path); }).find("several lists") !=
          std::string::npos);
  }
  SECTION("all that is read counts together") {
    constexpr std::size_t kBytes = 60 * testing::kBombMiB;
    model.files["zeros"] = std::string(kBytes, '\0');
    model.write_bundle(path);
    ImportMemory memory({}, path);
    const auto files = zip_files(path, memory);
    REQUIRE(files.ok());
    for (int i = 0; i < 4; ++i) CHECK(files.value()->read("zeros", memory).ok());
    const auto fifth = files.value()->read("zeros", memory);
    CHECK(fifth.status().code() == StatusCode::kUnsupported);
  }
}

TEST_CASE("a compressed meta.json counts with the memory that its values take") {
  SogModel model = testing::random_sog(1, 0, 1);
  std::string text = model.meta.dump();
  text.pop_back();
  text += ",\"bomb\":[[]";
  while (text.size() < (8 << 20)) text += ",[]";
  model.files["meta.json"] = text + "]}";
  CHECK(refusal_of(model, import_sog).find("memory limit") != std::string::npos);
  model.files["meta.json"] = text + "],\"version\":4}";
  CHECK(refusal_of(model, [](const std::string& path) {
          return read_tsog(path, {}, kBombLimits);
        }).find("memory limit") != std::string::npos);
}

TEST_CASE("pieces of curved paths count beside the paths") {
  constexpr int kSplats = 500'000;
  SogModel model = testing::random_sogst(8, 0, 2, 1);
  model.meta["count"] = kSplats;
  for (auto& [name, image] : model.images) image = flat(1000, kSplats / 1000);
  CHECK(refusal_of(model, [](const std::string& path) {
          return read_sogst(path, {}, kBombLimits, nullptr, nullptr);
        }).find("memory limit") != std::string::npos);
}

TEST_CASE("the list of a zip archive with many members counts") {
  SogModel model = testing::random_sog(1, 0, 1);
  for (int i = 0; i < 200'000; ++i) model.files[std::to_string(i)] = "";
  refusal_of(model, [](const std::string& path) { return read_sog(path, {200'000'000, 1 << 20}); });
}

}  // namespace stgs
