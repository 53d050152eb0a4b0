// SPDX-License-Identifier: Apache-2.0
// Small files that tests change under valid checksums, and the findings of reader and validator.
#pragma once

#include <cstring>
#include <set>
#include <string>
#include <vector>

#include "catch.h"
#include "fixtures/copy_fixture.h"
#include "fixtures/scene_fixture.h"

namespace stgs::testing {

using Bytes = std::vector<std::uint8_t>;

// Without the copy of its head, so that damage to the head is not repaired.
inline Bytes small_file(Profile profile, std::size_t n = 40, bool own_layouts = false,
                        SceneCoder coder = SceneCoder::kRans) {
  WriteSettings settings;
  settings.profile = profile;
  settings.chunk_seconds = 0.5;
  settings.own_layouts = own_layouts;
  settings.coder = coder;
  auto bytes = encode_scene(random_scene(n, 1, 30, 21), settings);
  REQUIRE(bytes.ok());
  return without_copy(std::move(*bytes));
}

// Opens and decodes the complete file.
inline Status read_all(Bytes bytes) {
  return read_scene(memory_source(std::move(bytes), "x.stgs")).status();
}

inline std::vector<Issue> issues_of(Bytes bytes, const ReadLimits& limits = {}) {
  auto issues = validate_scene(*memory_source(std::move(bytes), "x.stgs"), limits);
  INFO(issues.status().message());
  REQUIRE(issues.ok());
  return std::move(*issues);
}

inline std::set<int> numbers_of(const std::vector<Issue>& issues) {
  std::set<int> out;
  for (const Issue& issue : issues) out.insert(issue.number);
  return out;
}

// Offset of the first record with this tag.
inline std::size_t record_at(const Bytes& bytes, const char* tag) {
  std::size_t at = kHeader;
  while (std::memcmp(bytes.data() + at, tag, 4) != 0) {
    at += kRecord + get<std::uint64_t>(bytes, at + 8);
    REQUIRE(at + kRecord <= bytes.size());
  }
  return at;
}
inline std::size_t metadata_at(const Bytes& bytes) {
  return record_at(bytes, "META");
}
inline std::size_t layouts_at(const Bytes& bytes) {
  return record_at(bytes, "LAYT");
}
inline std::size_t index_at(const Bytes& bytes) {
  return record_at(bytes, "INDX");
}
inline std::size_t body_at(const Bytes& bytes) {
  return get<std::uint32_t>(bytes, 24);
}

// Changes one field of a record, recomputes the checksums around it, and returns the number of
// the first issue. Reader and validator must agree on it.
template <typename Value>
int first_issue(Bytes bytes, std::size_t record, std::size_t offset, Value value) {
  put<Value>(bytes, record + kRecord + offset, value);
  seal_record(bytes, record);
  const Status status = read_all(bytes);
  CHECK_FALSE(status.ok());
  const auto issues = issues_of(bytes);
  REQUIRE_FALSE(issues.empty());
  INFO(status.message());
  CHECK(status.message().find(fmt::format("issue {})", issues.front().number)) !=
        std::string::npos);
  return issues.front().number;
}

}  // namespace stgs::testing
