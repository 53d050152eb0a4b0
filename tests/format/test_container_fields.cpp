// SPDX-License-Identifier: Apache-2.0
// Every field of a file is validated, here changed under valid checksums.
#include <algorithm>
#include <set>

#include "catch.h"
#include "damage_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using namespace stgs::testing;

TEST_CASE("every field of the header is validated") {
  const Bytes original = small_file(Profile::kLossless);
  const auto change = [&](std::size_t at, auto value) {
    Bytes bytes = original;
    put(bytes, at, value);
    seal_header(bytes);
    return std::make_pair(read_all(bytes), numbers_of(issues_of(bytes)));
  };
  CHECK(read_all({}).message() ==
        "x.stgs: too short for an .stgs file (expected at least 32 bytes, got 0); copy or download "
        "it again (byte 0, issue 101)");
  CHECK(change(0, std::uint8_t{0x88}).second == std::set<int>{102});
  CHECK(change(5, std::uint8_t{0x0D}).first.message().find("text-mode transfer") !=
        std::string::npos);
  for (const std::uint16_t major : {std::uint16_t{0}, std::uint16_t{1}, std::uint16_t{3}}) {
    CHECK(change(8, major).first.code() == StatusCode::kUnsupported);
    CHECK(change(8, major).second == std::set<int>{104});
  }
  CHECK(change(8, std::uint16_t{0}).first.message().find("create the file again") !=
        std::string::npos);
  CHECK(change(8, std::uint16_t{1}).first.message().find("stgs convert") != std::string::npos);
  CHECK(change(10, std::uint16_t{9}).first.ok());  // a newer minor version is read
  CHECK(change(12, std::uint32_t{4}).second == std::set<int>{105});
  CHECK(change(12, std::uint32_t{0x10000}).first.ok());
  CHECK(change(16, std::uint64_t{1} << 60).second.count(106) == 1);
  CHECK(change(24, ~std::uint32_t{0}).second == std::set<int>{107});
  CHECK(change(24, std::uint32_t{1}).second == std::set<int>{107});
}

TEST_CASE("every field of the metadata is validated") {
  const Bytes original = small_file(Profile::kLossless);
  const std::size_t at = metadata_at(original);
  CHECK(first_issue(original, at, 0, std::uint32_t{0}) == 202);
  CHECK(first_issue(original, at, 8, std::uint32_t{0}) == 202);
  for (std::size_t field : {12, 13, 14}) {
    CHECK(first_issue(original, at, field, std::uint8_t{7}) == 201);
    if (field == 13) continue;
    Bytes later = original;
    put<std::uint8_t>(later, at + kRecord + field, 128);  // players may treat it as 0
    seal_record(later, at);
    CHECK(read_all(later).ok());
    CHECK(numbers_of(issues_of(later)) == std::set<int>{201});  // a warning
  }
  for (std::size_t field : {18, 19}) {  // colours that are displayed as others
    Bytes later = original;
    put<std::uint8_t>(later, at + kRecord + field, 2);
    seal_record(later, at);
    CHECK(read_all(later).ok());
    CHECK(numbers_of(issues_of(later)) == std::set<int>{208});
  }
  CHECK(first_issue(original, at, 15, std::uint8_t{4}) == 203);
  CHECK(first_issue(original, at, 20, NAN) == 204);
  CHECK(first_issue(original, at, 32, 1e30f) == 204);
  CHECK(first_issue(original, at, 132, std::uint32_t{0xFFFFFFFF}) == 200);
  CHECK(first_issue(original, at, 136, std::uint8_t{0xFF}) == 205);
}

TEST_CASE("an invalid start camera is rejected") {
  Scene scene = random_scene(2, 0, 30, 21);
  StartCamera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 500.0f;
  scene.metadata.start_camera = camera;
  const auto original = encode_scene(scene, {});
  REQUIRE(original.ok());
  REQUIRE(issues_of(*original).empty());
  const std::size_t at = metadata_at(*original);
  CHECK(first_issue(*original, at, 60, std::uint32_t{0}) == 204);
  CHECK(first_issue(*original, at, 60, std::uint32_t{32769}) == 204);
  CHECK(first_issue(*original, at, 64, ~std::uint32_t{0}) == 204);
  CHECK(first_issue(*original, at, 68, -1.0f) == 204);  // a mirror
  CHECK(first_issue(*original, at, 72, 0.01f) == 204);  // a shear
  CHECK(first_issue(*original, at, 72, 3e38f) == 204);
  CHECK(first_issue(*original, at, 116, 0.0f) == 204);
}

TEST_CASE("every field of a segment is validated") {
  const Bytes original = small_file(Profile::kLossless);
  const std::size_t at = body_at(original);
  CHECK(first_issue(original, at, 0, std::int16_t{3}) == 400);
  CHECK(first_issue(original, at, 8, std::uint32_t{5}) == 400);
  CHECK(first_issue(original, at, 12, std::uint16_t{1}) == 409);
  CHECK(first_issue(original, at, 12, std::uint16_t{0xFFFE}) == 409);
  CHECK(first_issue(original, at, 12, std::uint16_t{0xFFFF}) == 409);  // its own, missing
  CHECK(first_issue(original, at, 14, ~std::uint32_t{0}) == 401);      // n_1
  CHECK(first_issue(original, at, 18, ~std::uint32_t{0}) == 401);      // the size of the first unit
  CHECK(first_issue(original, at, 18, get<std::uint32_t>(original, at + kRecord + 18) - 1) == 405);
}

TEST_CASE("every field of a layout is validated") {
  // Without rANS there are no tables before the rows.
  const Bytes original = small_file(Profile::kLossless, 40, false, SceneCoder::kBytes);
  const std::size_t at = layouts_at(original), row = 7, next = row + 17;
  REQUIRE(get<std::uint16_t>(original, at + kRecord) == 0);
  REQUIRE(get<std::uint16_t>(original, at + kRecord + next) == 2);
  CHECK(first_issue(original, at, 0, std::uint16_t{0xFFFF}) == 409);
  CHECK(first_issue(original, at, 0, std::uint16_t{1024}) == 409);
  CHECK(first_issue(original, at, 2, std::uint16_t{2}) == 409);
  CHECK(first_issue(original, at, 2, std::uint16_t{0}) == 409);  // the segments' layout is missing
  CHECK(first_issue(original, at, 4, std::uint8_t{8}) == 402);   // streams are missing
  CHECK(first_issue(original, at, row, std::uint16_t{2}) == 402);
  CHECK(first_issue(original, at, next, std::uint16_t{8}) == 402);
  CHECK(first_issue(original, at, row, std::uint16_t{0x4000}) == 403);
  CHECK(first_issue(original, at, row, std::uint16_t{0x8000}) == 402);
  CHECK(first_issue(original, at, row + 2, std::uint8_t{200}) == 403);
  CHECK(first_issue(original, at, row + 2, std::uint8_t{4}) == 404);
  CHECK(first_issue(original, at, row + 3, std::uint8_t{200}) == 403);
  CHECK(first_issue(original, at, row + 3, std::uint8_t{3}) == 404);
  CHECK(first_issue(original, at, row + 4, std::uint8_t{9}) == 403);
  CHECK(first_issue(original, at, row + 5, std::uint8_t{1}) == 404);
  CHECK(first_issue(original, at, row - 2, std::uint16_t{5}) == 409);  // the row's size
  CHECK(first_issue(original, at, row - 2, std::uint16_t{13}) == 409);
  CHECK(first_issue(original, at, row - 2, std::uint16_t{0xFFFF}) == 409);
  CHECK(first_issue(original, at, row + 6, std::int8_t{24}) == 404);
  CHECK(first_issue(original, at, row + 7, std::uint8_t{3}) == 404);
  CHECK(first_issue(original, at, row + 8, std::uint8_t{1}) == 404);
  CHECK(first_issue(original, at, row + 9, std::uint8_t{0}) == 404);
  CHECK(first_issue(original, at, row + 9, std::uint8_t{9}) == 404);
  CHECK(first_issue(original, at, row + 10, std::uint8_t{4}) == 404);
  CHECK(first_issue(original, at, row + 11, std::uint8_t{0}) == 404);
  CHECK(first_issue(original, at, row + 11, std::uint8_t{9}) == 404);

  // With rANS, the rows follow the tables.
  const Bytes coded = small_file(Profile::kQuantised, 3000);
  const std::size_t tables_at = layouts_at(coded);
  REQUIRE(get<std::uint16_t>(coded, tables_at + kRecord) > 0);
  CHECK(first_issue(coded, tables_at, 0, std::uint16_t{1025}) == 409);
  Bytes bytes = coded;
  const auto length = get<std::uint64_t>(bytes, tables_at + 8);
  put<std::uint16_t>(bytes, tables_at + kRecord + length - 2, 1023);  // the last plane's table
  seal_record(bytes, tables_at);
  CHECK(numbers_of(issues_of(bytes)).count(409) == 1);
  CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
}

TEST_CASE("the validator detects values that violate the representation") {
  const Bytes original = small_file(Profile::kLossless);
  const std::size_t at = body_at(original);
  // Wrong bounds and a wrong chunk length need no change to the streams.
  Bytes bytes = original;
  put<float>(bytes, metadata_at(bytes) + kRecord + 44, -1e3f);
  put<float>(bytes, metadata_at(bytes) + kRecord + 32, -2e3f);
  seal_record(bytes, metadata_at(bytes));
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{505});
  CHECK(read_all(bytes).ok());  // a warning
  bytes = original;
  FileHead head = head_of(bytes);
  head.parts[0].chunk_ticks = 5;
  CHECK(numbers_of(issues_of(with_index(bytes, head))).count(504) == 1);
  REQUIRE(at < original.size());
}

TEST_CASE("values that cannot be rendered are rejected although every checksum is valid") {
  // The streams of a single primitive are all stored, in the order of their rows.
  auto scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  WriteSettings settings;
  settings.coder = SceneCoder::kBytes;
  auto encoded = encode_scene(scene, settings);
  REQUIRE(encoded.ok());
  const Bytes original = without_copy(*encoded);
  const std::size_t at = body_at(original), sizes = at + kRecord + 14;
  const auto broken = [&](std::size_t attribute, float value) {
    Bytes bytes = original;
    std::size_t stream = sizes + std::size_t{9} * 4;
    for (std::size_t i = 0; i < attribute; ++i) {
      stream += get<std::uint32_t>(bytes, sizes + 4 * i);
    }
    const auto size = get<std::uint32_t>(bytes, sizes + 4 * attribute);
    REQUIRE(size % 4 == 0);
    // The planes of each component, one byte each.
    for (std::size_t c = 0; c < size; c += 4) put<float>(bytes, stream + c, value);
    seal_record(bytes, at);
    CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
    return numbers_of(issues_of(bytes));
  };
  CHECK(broken(0, NAN).count(500) == 1);
  CHECK(broken(5, INFINITY).count(500) == 1);
  CHECK(broken(2, 0.0f).count(501) == 1);
  CHECK(broken(2, -1.0f).count(501) == 1);
  CHECK(broken(3, -1.0f).count(502) == 1);
  CHECK(broken(6, 0.0f).count(503) == 1);
}

TEST_CASE("the flags of META, LAYT, INDX and SEGM are validated") {
  const Bytes original = small_file(Profile::kLossless);
  const auto with_flags = [&](std::size_t at, std::uint32_t flags) {
    Bytes bytes = original;
    put<std::uint32_t>(bytes, at + 4, flags);
    seal_record(bytes, at);
    return std::make_pair(read_all(bytes).code(), numbers_of(issues_of(bytes)));
  };
  const auto not_critical = std::make_pair(StatusCode::kInvalidFile, std::set<int>{116});
  const auto unknown = std::make_pair(StatusCode::kUnsupported, std::set<int>{113});
  for (std::size_t at : {index_at(original), body_at(original)}) {
    CHECK(with_flags(at, 0) == not_critical);
    CHECK(with_flags(at, 3) == unknown);
    CHECK(with_flags(at, 0x80000001) == unknown);
  }
  // 115: META is missing then.
  CHECK(with_flags(metadata_at(original), 0).second == std::set<int>{115, 116});
  CHECK(with_flags(metadata_at(original), 3).first == StatusCode::kUnsupported);
  // 409: no layout is left.
  CHECK(with_flags(layouts_at(original), 0).second == std::set<int>{116, 409});
  CHECK(with_flags(layouts_at(original), 3).first == StatusCode::kUnsupported);
  CHECK(with_flags(body_at(original), 2) == not_critical);  // listed, so it cannot be skipped
  CHECK(with_flags(metadata_at(original), 2).second == std::set<int>{115, 116});
}

TEST_CASE("the flags of a segment that is not in the index are validated") {
  const Bytes original = small_file(Profile::kLossless);
  for (std::uint32_t flags : {0u, 1u, 2u, 3u}) {
    Bytes extra(kRecord + 16, 0);
    std::memcpy(extra.data(), "SEGM", 4);
    put<std::uint32_t>(extra, 4, flags);
    put<std::uint64_t>(extra, 8, 16);
    seal_record(extra, 0);
    Bytes bytes = original;
    bytes.insert(bytes.end(), extra.begin(), extra.end());
    put<std::uint64_t>(bytes, 16, bytes.size());
    seal_header(bytes);
    const std::set<int> expected[] = {{116}, {310}, {116}, {113}};
    CHECK(numbers_of(issues_of(bytes)) == expected[flags]);
  }
}

TEST_CASE("unknown records are skipped unless they are critical") {
  const Bytes original = small_file(Profile::kLossless);
  for (std::uint32_t critical : {0u, 1u}) {
    Bytes extra(kRecord + 5, 0x55);
    std::memcpy(extra.data(), "NOTE", 4);
    put<std::uint32_t>(extra, 4, critical);
    put<std::uint64_t>(extra, 8, 5);
    seal_record(extra, 0);
    // After the last segment.
    Bytes bytes = original;
    bytes.insert(bytes.end(), extra.begin(), extra.end());
    put<std::uint64_t>(bytes, 16, bytes.size());
    seal_header(bytes);
    CHECK(issues_of(bytes).empty() == (critical == 0));
    CHECK(read_all(bytes).ok());
    // In the head, before META.
    bytes = with_index(original, head_of(original), extra);
    const Status status = read_all(bytes);
    CHECK(status.code() == (critical == 0 ? StatusCode::kOk : StatusCode::kUnsupported));
    CHECK(numbers_of(issues_of(bytes)) == (critical == 0 ? std::set<int>{} : std::set<int>{113}));
  }
}
