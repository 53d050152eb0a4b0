// SPDX-License-Identifier: Apache-2.0
// Records fragments into a file and opens it.
#pragma once

#include <filesystem>
#include <fstream>
#include <set>

#include "catch.h"
#include "fragment_fixture.h"
#include "temporary_folder.h"

namespace stgs::testing {

inline std::vector<std::uint8_t> bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Records `count` fragments. Returns the file size before the first, after each, and after close().
inline std::vector<std::uint64_t> record(const std::string& path, std::uint32_t count, bool close,
                                         Profile profile = Profile::kLossless,
                                         std::size_t primitives = 60) {
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings(profile));
  INFO(recorder.status().message());
  REQUIRE(recorder.ok());
  std::vector<std::uint64_t> sizes = {(*recorder)->bytes()};
  for (std::uint32_t i = 0; i < count; ++i) {
    const Status status =
        (*recorder)->append(make_fragment(i, primitives), (i + 1) * kFragmentFrames);
    INFO(status.message());
    REQUIRE(status.ok());
    CHECK((*recorder)->frames() == (i + 1) * kFragmentFrames);
    sizes.push_back((*recorder)->bytes());
    CHECK(std::filesystem::file_size(path) == sizes.back());
  }
  if (close) {
    REQUIRE((*recorder)->close().ok());
    sizes.push_back((*recorder)->bytes());
  }
  return sizes;
}

inline std::unique_ptr<SceneReader> open_scene(const std::string& path) {
  auto reader = SceneReader::open(path);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  return std::move(*reader);
}

// Fingerprints of the primitives in a part.
inline std::multiset<std::string> fingerprints_of(const SceneReader& reader, std::uint32_t part) {
  std::multiset<std::string> out;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    if (reader.segments()[s].part != part) continue;
    const auto set = reader.decode(s);
    INFO(set.status().message());
    REQUIRE(set.ok());
    for (std::string& print : fingerprints(*set)) out.insert(std::move(print));
  }
  return out;
}

inline std::multiset<std::string> fingerprints_of(const Gaussians4D& set) {
  const auto prints = fingerprints(set);
  return {prints.begin(), prints.end()};
}

// Finalizes an undamaged recording; an incomplete fragment at its end is left out.
inline void finalize_intact(const std::string& path, const std::string& finished) {
  DamageReport report;
  const Status status = finalize_scene(std::move(*open_file(path)), finished, report);
  INFO(status.message());
  REQUIRE(status.ok());
  CHECK(report.damage.empty());
  CHECK(report.reason.ok());
}

inline std::set<int> issues_of(const std::vector<std::uint8_t>& bytes) {
  const auto issues = validate_scene(*memory_source(bytes));
  REQUIRE(issues.ok());
  std::set<int> numbers;
  for (const Issue& issue : *issues) numbers.insert(issue.number);
  return numbers;
}

}  // namespace stgs::testing
