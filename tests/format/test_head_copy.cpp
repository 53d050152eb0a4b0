// SPDX-License-Identifier: Apache-2.0
// The copy of a file's head: when it replaces a damaged head, and how that is reported.
#include <fstream>

#include "catch.h"
#include "damage_fixture.h"
#include "fixtures/copy_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/scene_recorder.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

Bytes file_with_copy(std::size_t n = 40) {
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  auto bytes = encode_scene(random_scene(n, 1, 30, 21), settings);
  REQUIRE(bytes.ok());
  REQUIRE(copy_at(*bytes) < bytes->size());
  return std::move(*bytes);
}

int first_issue_number(const Bytes& bytes, const ReadLimits& limits = {}) {
  const Status status = SceneReader::open(memory_source(bytes), limits).status();
  if (status.ok()) return 0;
  return std::stoi(status.message().substr(status.message().rfind("issue ") + 6));
}

// The file with this payload in its COPY record.
Bytes with_copy(const Bytes& bytes, const Bytes& payload) {
  Bytes out(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(copy_at(bytes)));
  const std::size_t at = out.size();
  out.resize(at + kRecord);
  std::memcpy(out.data() + at, "COPY", 4);
  put<std::uint64_t>(out, at + 8, payload.size());
  out.insert(out.end(), payload.begin(), payload.end());
  seal_record(out, at);
  put<std::uint64_t>(out, 16, out.size());
  seal_header(out);
  return out;
}

Bytes payload_of_copy(const Bytes& bytes) {
  return {bytes.begin() + static_cast<std::ptrdiff_t>(copy_at(bytes) + kRecord), bytes.end()};
}

}  // namespace

TEST_CASE("a damaged head is read from its copy, and that is reported") {
  Bytes bytes = file_with_copy();
  const auto intact = read_scene(memory_source(bytes));
  bytes[index_at(bytes) + kRecord + 3] ^= 4;
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  CHECK(numbers_of((*reader)->damage()) == std::set<int>{118});
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{118});
  CHECK((*reader)->missing_bytes() == 0);
  CHECK((*reader)->complete_ticks() == 30);
  const auto read = read_scene(memory_source(bytes));
  REQUIRE(read.ok());
  CHECK(fingerprints(read->gaussians) == fingerprints(intact->gaussians));
}

TEST_CASE("finalize repairs a damaged head to the original bytes") {
  const TemporaryFolder folder;
  const Bytes intact = file_with_copy();
  DamageReport report;
  CHECK(finalize_scene(memory_source(intact), folder / "x.stgs", report).code() ==
        StatusCode::kUsage);
  for (const std::size_t at : {std::size_t{4}, std::size_t{26}, index_at(intact) + kRecord}) {
    Bytes bytes = intact;
    bytes[at] ^= 8;
    REQUIRE(finalize_scene(memory_source(bytes), folder / "repaired.stgs", report).ok());
    CHECK(numbers_of(report.damage) == std::set<int>{118});
    std::ifstream file(folder / "repaired.stgs", std::ios::binary);
    CHECK(Bytes(std::istreambuf_iterator<char>(file), {}) == intact);
  }
}

TEST_CASE("a file whose head and copy are both damaged is rejected") {
  for (const std::size_t damaged : {std::size_t{0}, std::size_t{20}, kHeader + 5, kHeader + 40}) {
    Bytes bytes = file_with_copy();
    const int without = [&] {
      Bytes plain = without_copy(bytes);
      plain[damaged] ^= 1;
      return first_issue_number(plain);
    }();
    bytes[damaged] ^= 1;
    CHECK(first_issue_number(bytes) == 0);
    bytes[copy_at(bytes) + kRecord + 50] ^= 1;
    CHECK(first_issue_number(bytes) == without);
    CHECK(without > 0);
  }
}

TEST_CASE("a copy of another head is not used") {
  const Bytes original = file_with_copy(), other = file_with_copy(41);
  Bytes bytes = with_copy(original, payload_of_copy(other));
  CHECK(first_issue_number(bytes) == 0);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{119});
  bytes[metadata_at(bytes) + kRecord] ^= 1;
  CHECK(first_issue_number(bytes) == 112);
  // The header of this file with records of another.
  Bytes payload = payload_of_copy(other);
  std::copy_n(original.begin(), kHeader, payload.begin());
  bytes = with_copy(original, payload);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{119});
  // A header that states a size other than the file's.
  bytes = file_with_copy();
  bytes[3] ^= 1;
  CHECK(first_issue_number(bytes) == 0);
  bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(copy_at(bytes)), 7, 0);
  CHECK(first_issue_number(bytes) == 102);
}

TEST_CASE("a copy does not bypass the checks of the head") {
  const Bytes original = file_with_copy();
  Bytes newer = original;
  put<std::uint16_t>(newer, 8, 3);  // an unknown major version is not damage
  seal_header(newer);
  CHECK(first_issue_number(newer) == 104);
  Bytes oversized = original;
  put<std::uint32_t>(oversized, 24, ~std::uint32_t{0});
  seal_header(oversized);
  CHECK(first_issue_number(oversized) == 107);
  // Only the copy states a head that is larger than the file.
  Bytes payload = payload_of_copy(original);
  put<std::uint32_t>(payload, 24, std::uint32_t{1} << 30);
  seal_header(payload);
  Bytes bytes = with_copy(original, payload);
  bytes[0] ^= 1;
  CHECK(first_issue_number(bytes) == 102);
  // A copy with a head size that matches no record boundary.
  put<std::uint32_t>(payload, 24, kHeader + 7);
  seal_header(payload);
  bytes = with_copy(original, payload);
  bytes[0] ^= 1;
  CHECK(first_issue_number(bytes) == 102);
}

TEST_CASE("a misplaced copy is reported") {
  const Bytes original = file_with_copy();
  Bytes twice = original;
  const Bytes copy(original.begin() + static_cast<std::ptrdiff_t>(copy_at(original)),
                   original.end());
  twice.insert(twice.end(), copy.begin(), copy.end());
  put<std::uint64_t>(twice, 16, twice.size());
  seal_header(twice);
  CHECK(read_all(twice).ok());
  CHECK(numbers_of(issues_of(twice)) == std::set<int>{119});
}
