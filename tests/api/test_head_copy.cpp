// SPDX-License-Identifier: Apache-2.0
// The copy of a head: which one is taken for a damaged head, and what is said of it.
#include <fstream>

#include "catch.h"
#include "copy_fixture.h"
#include "damage_fixture.h"
#include "stgs/format/scene_recorder.h"
#include "temporary_folder.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

Bytes copied_file(std::size_t n = 40) {
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  auto bytes = encode_scene(random_scene(n, 1, 30, 21), settings);
  REQUIRE(bytes.ok());
  REQUIRE(copy_at(*bytes) < bytes->size());
  return std::move(*bytes);
}

int first_number(const Bytes& bytes, const ReadLimits& limits = {}) {
  const Status status = SceneReader::open(memory_source(bytes), limits).status();
  if (status.ok()) return 0;
  return std::stoi(status.message().substr(status.message().rfind("issue ") + 6));
}

// The file with this in place of its copy's payload.
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

TEST_CASE("a damaged head is read from its copy, which is told") {
  Bytes bytes = copied_file();
  const auto sound = read_scene(memory_source(bytes));
  bytes[index_at(bytes) + kRecord + 3] ^= 4;
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  CHECK(numbers_of((*reader)->damage()) == std::set<int>{118});
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{118});
  CHECK((*reader)->missing_bytes() == 0);
  CHECK((*reader)->complete_ticks() == 30);
  const auto read = read_scene(memory_source(bytes));
  REQUIRE(read.ok());
  CHECK(fingerprints(read->gaussians) == fingerprints(sound->gaussians));
}

TEST_CASE("a damaged head is mended by finalize, to the byte") {
  const TemporaryFolder folder;
  const Bytes sound = copied_file();
  DamageReport losses;
  CHECK(finalize_scene(memory_source(sound), folder / "x.stgs", losses).code() ==
        StatusCode::kUsage);
  for (const std::size_t at : {std::size_t{4}, std::size_t{30}, index_at(sound) + kRecord}) {
    Bytes bytes = sound;
    bytes[at] ^= 8;
    REQUIRE(finalize_scene(memory_source(bytes), folder / "mended.stgs", losses).ok());
    CHECK(numbers_of(losses.damage) == std::set<int>{118});
    std::ifstream file(folder / "mended.stgs", std::ios::binary);
    CHECK(Bytes(std::istreambuf_iterator<char>(file), {}) == sound);
  }
}

TEST_CASE("a head and its copy that are both damaged are refused") {
  for (const std::size_t damaged : {std::size_t{0}, std::size_t{20}, kHeader + 5, kHeader + 40}) {
    Bytes bytes = copied_file();
    const int without = [&] {
      Bytes plain = without_copy(bytes);
      plain[damaged] ^= 1;
      return first_number(plain);
    }();
    bytes[damaged] ^= 1;
    CHECK(first_number(bytes) == 0);
    bytes[copy_at(bytes) + kRecord + 50] ^= 1;
    CHECK(first_number(bytes) == without);
    CHECK(without > 0);
  }
}

TEST_CASE("the copy of another head is not taken") {
  const Bytes own = copied_file(), other = copied_file(41);
  Bytes bytes = with_copy(own, payload_of_copy(other));
  CHECK(first_number(bytes) == 0);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{119});
  bytes[metadata_at(bytes) + kRecord] ^= 1;
  CHECK(first_number(bytes) == 112);
  // The header of the file, but other records.
  Bytes payload = payload_of_copy(other);
  std::copy_n(own.begin(), kHeader, payload.begin());
  bytes = with_copy(own, payload);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{119});
  bytes[metadata_at(bytes) + kRecord] ^= 1;
  CHECK(first_number(bytes) == 112);
  // A header that states another size than the file has.
  bytes = copied_file();
  bytes[3] ^= 1;
  CHECK(first_number(bytes) == 0);
  bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(copy_at(bytes)), 7, 0);
  CHECK(first_number(bytes) == 102);
}

TEST_CASE("a copy is no way round what a reader refuses") {
  const Bytes own = copied_file();
  Bytes later = own;
  put<std::uint16_t>(later, 8, 2);  // a major version of its own is no damage
  seal_header(later);
  CHECK(first_number(later) == 104);
  Bytes longer = own;
  put<std::uint64_t>(longer, 24, std::uint64_t{1} << 60);
  seal_header(longer);
  CHECK(first_number(longer) == 107);
  // A head that is larger than the file, which only the copy states.
  Bytes payload = payload_of_copy(own);
  put<std::uint64_t>(payload, 24, std::uint64_t{1} << 40);
  put<std::uint64_t>(payload, 16, own.size());
  put<std::uint64_t>(payload, 32, XXH3_64bits(payload.data(), 32));
  Bytes bytes = with_copy(own, payload);
  bytes[0] ^= 1;
  CHECK(first_number(bytes) == 102);
  // A copy with a head that fits nothing.
  put<std::uint64_t>(payload, 24, kHeader + 7);
  put<std::uint64_t>(payload, 32, XXH3_64bits(payload.data(), 32));
  bytes = with_copy(own, payload);
  bytes[0] ^= 1;
  CHECK(first_number(bytes) == 102);
}

TEST_CASE("a copy that is not where readers look is told") {
  const Bytes own = copied_file();
  Bytes twice = own;
  const Bytes copy(own.begin() + static_cast<std::ptrdiff_t>(copy_at(own)), own.end());
  twice.insert(twice.end(), copy.begin(), copy.end());
  put<std::uint64_t>(twice, 16, twice.size());
  seal_header(twice);
  CHECK(read_all(twice).ok());
  CHECK(numbers_of(issues_of(twice)) == std::set<int>{119});
}
