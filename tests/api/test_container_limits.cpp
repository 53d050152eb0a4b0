// SPDX-License-Identifier: Apache-2.0
// What hostile files may cost a reader.
#include <sys/resource.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include "damage_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

// One primitive of degree 0: nine streams, all stored.
Bytes one_primitive() {
  auto scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  auto encoded = encode_scene(scene, {});
  REQUIRE(encoded.ok());
  return std::move(*encoded);
}

constexpr std::size_t kStreams = 9, kSizes = 22, kFirstStream = kSizes + 8 * kStreams;
constexpr std::size_t kRows = 7, kRow = 16;  // of a layout that has no tables

// Replaces the bytes of stream `attribute` of that file, and all sizes around them.
void replace_stream(Bytes& bytes, std::size_t attribute, const Bytes& stored) {
  FileHead head = head_of(bytes);
  const std::size_t at = body_at(bytes), sizes = at + kRecord + kSizes;
  std::size_t stream = at + kRecord + kFirstStream;
  for (std::size_t i = 0; i < attribute; ++i) stream += get<std::uint64_t>(bytes, sizes + 8 * i);
  const auto size = get<std::uint64_t>(bytes, sizes + 8 * attribute);
  const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(stream);
  bytes.insert(bytes.erase(begin, begin + static_cast<std::ptrdiff_t>(size)), stored.begin(),
               stored.end());
  put<std::uint64_t>(bytes, sizes + 8 * attribute, stored.size());
  put<std::uint64_t>(bytes, at + 8, bytes.size() - at - kRecord);
  seal_record(bytes, at);
  head.index.segments[0].base.bytes = bytes.size() - at;
  bytes = with_index(bytes, head);
}

// Makes a file of one record claim so many primitives, in the index and in the record.
void claim(Bytes& bytes, std::uint32_t primitives) {
  FileHead head = head_of(bytes);
  REQUIRE(head.index.segments.size() == 1);
  head.index.primitives = head.index.segments[0].base.primitives = primitives;
  bytes = with_index(bytes, head);
  const std::size_t at = body_at(bytes);
  put<std::uint32_t>(bytes, at + kRecord + 8, primitives);
  seal_record(bytes, at);
}

// A zstd frame of one raw block that states `size` bytes of content.
Bytes zstd_frame(std::uint32_t size, const Bytes& content) {
  Bytes out(12 + content.size());
  put<std::uint32_t>(out, 0, 0xFD2FB528);
  put<std::uint8_t>(out, 4, 0xA0);  // one segment, size in four bytes
  put<std::uint32_t>(out, 5, size);
  const auto block = static_cast<std::uint32_t>(content.size() << 3 | 1);  // raw, the last
  for (std::size_t i = 0; i < 3; ++i) out[9 + i] = static_cast<std::uint8_t>(block >> (8 * i));
  std::copy(content.begin(), content.end(), out.begin() + 12);
  return out;
}

long peak_kib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

}  // namespace

TEST_CASE("a zstd stream is one frame") {
  const Bytes whole = one_primitive();
  const Bytes content(whole.end() - 12, whole.end());  // sh0, the last stream
  Bytes bytes = whole;
  replace_stream(bytes, 8, zstd_frame(12, content));
  CHECK(issues_of(bytes).empty());
  Bytes frames = zstd_frame(12, content);
  const Bytes empty = zstd_frame(0, {});
  frames.insert(frames.end(), empty.begin(), empty.end());
  bytes = whole;
  replace_stream(bytes, 8, frames);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
  CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
}

TEST_CASE("a segment's memory is not allocated before its streams can fill it") {
  constexpr std::uint32_t kClaim = 3'000'000;  // 240 MB of floats
  const Bytes filler(kClaim / 16);             // so many primitives need as many bytes
  const auto check = [](const Bytes& bytes) {
    const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
    REQUIRE(reader.ok());
    const long before = peak_kib();
    const Status status = (*reader)->decode(0).status();
    CHECK(status.message().find("issue 405") != std::string::npos);
    CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
    CHECK(peak_kib() - before < 64 * 1024);
  };
  for (bool lying_frames : {false, true}) {
    Bytes bytes = one_primitive();
    for (std::size_t i = 0; lying_frames && i < kStreams; ++i) {
      const std::size_t row = layouts_at(bytes) + kRecord + kRows + kRow * i;
      const auto planes = get<std::uint8_t>(bytes, row + 2) * get<std::uint8_t>(bytes, row + 8);
      replace_stream(bytes, i,
                     zstd_frame(kClaim * static_cast<std::uint32_t>(planes),
                                i == 0 ? filler : Bytes{1, 2, 3}));
    }
    if (!lying_frames) replace_stream(bytes, 0, filler);
    claim(bytes, kClaim);
    check(bytes);
  }
  // Planes of one symbol take no bits, but each block of 2048 primitives has its lanes' states.
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  const std::vector<std::uint32_t> copies(10000, 0);
  scene.gaussians = scene.gaussians.gather(copies);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  auto constant = encode_scene(scene, settings);
  REQUIRE(constant.ok());
  CHECK(issues_of(*constant).empty());
  CHECK(constant->size() < 2500);
  const auto record = static_cast<std::uint32_t>(constant->size() - body_at(*constant));
  claim(*constant, 16 * record);
  check(*constant);
  claim(*constant, 16 * record + 1);
  CHECK(numbers_of(issues_of(*constant)) == std::set<int>{305});
}

TEST_CASE("primitives that are all alike keep the bytes that their number needs") {
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  scene.gaussians = scene.gaussians.gather(std::vector<std::uint32_t>(200'000, 0));
  for (const SceneCoder coder : {SceneCoder::kRans, SceneCoder::kZstd}) {
    for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
      WriteSettings settings;
      settings.profile = profile;
      settings.coder = coder;
      const auto bytes = encode_scene(scene, settings);
      REQUIRE(bytes.ok());
      CHECK(issues_of(*bytes).empty());
      CHECK(read_all(*bytes).ok());
    }
  }
}

TEST_CASE("all that decoding a segment takes counts") {
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    for (const bool own_layouts : {false, true}) {
      const Bytes bytes = small_file(profile, 40, own_layouts);
      const auto fits = [&](std::uint64_t limit) {
        const auto reader = SceneReader::open(memory_source(bytes), {1000, limit});
        bool all = reader.ok();
        for (std::uint32_t i = 0; all && i < (*reader)->segments().size(); ++i) {
          const Status status = (*reader)->decode(i).status();
          all = status.ok();
          if (!all && status.code() != StatusCode::kUnsupported) FAIL(status.message());
        }
        return all;
      };
      const auto reader = SceneReader::open(memory_source(bytes));
      REQUIRE(reader.ok());
      std::uint64_t floats = 0, stored = 0;
      for (const SegmentInfo& segment : (*reader)->segments()) {
        floats = std::max<std::uint64_t>(floats, segment.primitives * std::uint64_t{4 * (17 + 12)});
        stored = std::max(stored, segment.bytes + segment.harmonics_bytes);
      }
      CHECK_FALSE(fits(floats));
      CHECK_FALSE(fits(std::max(floats, stored) + 8));
      CHECK(fits(2 * floats + stored + (std::uint64_t{2048} << 14)));
    }
  }
}
