// SPDX-License-Identifier: Apache-2.0
// Recordings that are truncated, interrupted or written by another process.
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include "catch.h"
#include "fixtures/recording_fixture.h"
#include "stgs/format/output_file.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

namespace {

pid_t spawn(const std::string& path, int count, int milliseconds) {
  std::string words[4] = {STGS_RECORD_FRAGMENTS, path, std::to_string(count),
                          std::to_string(milliseconds)};
  char* arguments[5] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(),
                        nullptr};
  pid_t pid = 0;
  REQUIRE(::posix_spawn(&pid, words[0].c_str(), nullptr, nullptr, arguments, environ) == 0);
  return pid;
}

// Waits until the file has at least `bytes` bytes.
void wait_for(const std::string& path, std::uint64_t bytes) {
  std::error_code none;
  for (int i = 0; i < 30000 && !(fs::exists(path, none) && fs::file_size(path, none) >= bytes);
       ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace

TEST_CASE("a recording truncated at any byte is read up to its last complete fragment") {
  const TemporaryFolder folder;
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const std::string path = folder / profile_name(profile);
    const std::vector<std::uint64_t> sizes = record(path, 5, true, profile, 6);
    const Bytes original = bytes_of(path);
    REQUIRE(original.size() == sizes.back());
    for (std::size_t size = 0; size <= original.size(); ++size) {
      const Bytes cut(original.begin(), original.begin() + static_cast<std::ptrdiff_t>(size));
      const auto reader = SceneReader::open(memory_source(cut));
      if (size < sizes.front()) {  // within the head
        if (reader.status().code() != StatusCode::kInvalidFile) FAIL("opened " << size << " bytes");
        continue;
      }
      std::size_t complete = 0;
      while (complete + 1 < sizes.size() && sizes[complete + 1] <= size) ++complete;
      const bool closed = complete == 6;
      const std::size_t fragments = closed ? 5 : complete;
      const std::uint64_t rest = size - sizes[complete];
      if (!reader.ok() || (*reader)->incomplete_bytes() != rest ||
          (*reader)->primitives() != 6 * fragments ||
          (*reader)->form() != (closed ? SceneForm::kRecorded : SceneForm::kGrowing)) {
        FAIL(size << " bytes: " << reader.status().message());
      }
      const std::set<int> expected = rest > 0 ? std::set<int>{314} : std::set<int>{};
      if (issues_of(cut) != expected) FAIL(size << " bytes: wrong issues");
      if (fragments > 0 && (rest < 2 || rest == 40)) {
        const auto scene = read_scene(memory_source(cut));
        if (!scene.ok() || scene->gaussians.size() != 6 * fragments) FAIL("cannot read " << size);
      }
    }
  }
}

TEST_CASE("every changed byte of a recording is detected") {
  const TemporaryFolder folder;
  for (const bool close : {false, true}) {
    const std::string path = folder / (close ? "closed" : "open");
    record(path, 3, close, Profile::kQuantised, 5);
    const Bytes original = bytes_of(path);
    for (std::size_t at = 0; at < original.size(); ++at) {
      for (const int flip : {0x01, 0x80}) {
        Bytes damaged = original;
        damaged[at] = static_cast<std::uint8_t>(damaged[at] ^ flip);
        if (issues_of(damaged).empty()) FAIL("byte " << at << " ^ " << flip);
      }
    }
  }
}

TEST_CASE("a truncated recording is resumed to the same bytes") {
  const TemporaryFolder folder;
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const std::string path = folder / profile_name(profile);
    const auto sizes = record(path, 9, true, profile, 6);
    const Bytes original = bytes_of(path);
    std::vector<std::size_t> cuts(sizes.begin(), sizes.end() - 1);
    std::uint32_t state = 5;
    for (int i = 0; i < 40; ++i) {
      state = state * 1664525 + 1013904223;
      cuts.push_back(sizes.front() + state % (original.size() - sizes.front()));
    }
    for (const std::size_t size : cuts) {
      const std::string cut = folder / "cut.stgs";
      REQUIRE(write_file_atomically(cut, std::span(original).first(size)).ok());
      {
        auto recorder = SceneRecorder::resume(cut, recording_settings(profile));
        INFO(size << " of " << original.size() << " bytes: " << recorder.status().message());
        REQUIRE(recorder.ok());
        std::size_t complete = 0;
        while (complete + 1 < sizes.size() - 1 && sizes[complete + 1] <= size) ++complete;
        REQUIRE((*recorder)->frames() == complete * kFragmentFrames);
        CHECK((*recorder)->bytes() == sizes[complete]);
        CHECK(SceneRecorder::resume(cut, recording_settings(profile)).status().code() ==
              StatusCode::kUsage);  // one recorder at a time
        for (auto i = static_cast<std::uint32_t>(complete); i < 9; ++i) {
          REQUIRE((*recorder)->append(make_fragment(i, 6), (i + 1) * kFragmentFrames).ok());
        }
        REQUIRE((*recorder)->close().ok());
      }
      if (bytes_of(cut) != original) FAIL("different bytes after truncation to " << size);
    }
    CHECK(SceneRecorder::resume(path, recording_settings(profile)).status().code() ==
          StatusCode::kUsage);
  }
}

TEST_CASE("a recording is resumed after a kill and after a power cut") {
  const TemporaryFolder folder;
  const std::string path = folder / "killed.stgs";
  const pid_t writer = spawn(path, 100000, 0);
  wait_for(path, 20000);
  REQUIRE(::kill(writer, SIGKILL) == 0);
  int status = 0;
  REQUIRE(::waitpid(writer, &status, 0) == writer);
  const RecordSettings settings = recording_settings(Profile::kQuantised);
  CHECK(SceneRecorder::resume(path, recording_settings()).status().code() == StatusCode::kUsage);
  auto recorder = SceneRecorder::resume(path, settings);
  REQUIRE(recorder.ok());
  const std::uint32_t frames = (*recorder)->frames();
  REQUIRE(frames > 0);
  const std::uint32_t next = frames / kFragmentFrames;
  REQUIRE((*recorder)->append(make_fragment(next), frames + kFragmentFrames).ok());
  recorder->reset();
  CHECK(fingerprints_of(*open_scene(path), next).size() == 60);
  CHECK(issues_of(bytes_of(path)).empty());

  // The last fragment's index reached the disk, but some bytes of its segments did not.
  const std::string torn = folder / "torn.stgs";
  const auto sizes = record(torn, 4, false, Profile::kQuantised);
  Bytes bytes = bytes_of(torn);
  bytes[sizes[3] + 100] ^= 0x20;
  REQUIRE(write_file_atomically(torn, bytes).ok());
  recorder = SceneRecorder::resume(torn, settings);
  REQUIRE(recorder.ok());
  CHECK((*recorder)->frames() == 30);
  CHECK((*recorder)->bytes() == sizes[3]);
}

TEST_CASE(
    "a recording without the fragments that a power cut damaged is resumed, if they are few") {
  const TemporaryFolder folder;
  const RecordSettings settings = recording_settings(Profile::kQuantised);
  constexpr int kFragments = 80;
  const std::string path = folder / "whole.stgs";
  const std::vector<std::uint64_t> sizes = record(path, kFragments, false, Profile::kQuantised);
  const Bytes whole = bytes_of(path);
  for (const int damaged : {1, 3, 64, 65, 80}) {
    INFO(damaged << " fragments");
    Bytes bytes = whole;
    for (int i = kFragments - damaged; i < kFragments; ++i)
      bytes[static_cast<std::size_t>(sizes[static_cast<std::size_t>(i)]) + 100] ^= 0x20;
    const std::string torn = folder / "torn.stgs";
    REQUIRE(write_file_atomically(torn, bytes).ok());
    const auto recorder = SceneRecorder::resume(torn, settings);
    if (damaged <= 64) {
      REQUIRE(recorder.ok());
      CHECK((*recorder)->bytes() == sizes[static_cast<std::size_t>(kFragments - damaged)]);
    } else {
      CHECK(recorder.status().code() == StatusCode::kInvalidFile);
      CHECK(bytes_of(torn) == bytes);
    }
  }
}

TEST_CASE("a reader follows a recording of another process") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const pid_t writer = spawn(path, 12, 5);
  wait_for(path, 300);
  auto reader = open_scene(path);
  std::set<std::uint32_t> frame_counts;
  std::size_t segments = reader->segments().size();
  for (int i = 0; i < 60000 && reader->form() == SceneForm::kGrowing; ++i) {
    const auto grown = reader->refresh();
    INFO(grown.status().message());
    REQUIRE(grown.ok());
    REQUIRE(reader->segments().size() >= segments);
    for (; segments < reader->segments().size(); ++segments) {
      const auto set = reader->decode(static_cast<std::uint32_t>(segments));
      INFO(set.status().message());
      REQUIRE(set.ok());
    }
    frame_counts.insert(reader->metadata().frames);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  int status = -1;
  REQUIRE(::waitpid(writer, &status, 0) == writer);
  CHECK(status == 0);
  CHECK(reader->form() == SceneForm::kRecorded);
  CHECK(reader->metadata().frames == 120);
  CHECK(reader->primitives() == 12 * 60);
  CHECK(frame_counts.size() > 3);
  CHECK_FALSE(*reader->refresh());
}

TEST_CASE("fragments appended before a kill can be read and finalized") {
  const TemporaryFolder folder;
  const std::string reference = folder / "reference.stgs";
  record(reference, 40, false, Profile::kQuantised);
  const auto expected = open_scene(reference);
  for (const std::uint64_t bytes : {1u, 2000u, 9000u, 20000u, 40001u}) {
    const std::string path = folder / fmt::format("killed{}.stgs", bytes);
    const pid_t writer = spawn(path, 100000, 0);
    wait_for(path, bytes);
    REQUIRE(::kill(writer, SIGKILL) == 0);
    int status = 0;
    REQUIRE(::waitpid(writer, &status, 0) == writer);
    CHECK(WIFSIGNALED(status));
    const auto reader = SceneReader::open(path);
    if (bytes < 10) {  // possibly within the head
      CHECK((reader.ok() || reader.status().code() == StatusCode::kInvalidFile));
      continue;
    }
    REQUIRE(reader.ok());
    CHECK((*reader)->form() == SceneForm::kGrowing);
    const auto parts = static_cast<std::uint32_t>((*reader)->parts().size());
    REQUIRE(parts >= 1);
    for (std::uint32_t p = 0; p < std::min(parts, 40u); ++p) {
      CHECK(fingerprints_of(**reader, p) == fingerprints_of(*expected, p));
    }
    const std::string finished = folder / fmt::format("finished{}.stgs", bytes);
    finalize_intact(path, finished);
    CHECK(open_scene(finished)->parts().size() == parts);
    CHECK(issues_of(bytes_of(finished)).empty());
  }
}
