// SPDX-License-Identifier: Apache-2.0
// Files that grow: what is on disk when, what readers make of it, and what finalize makes of it.
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
#include "head_fixture.h"
#include "recording_fixture.h"
#include "stgs/format/output_file.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

namespace {

std::multiset<std::string> prints_of(const SceneReader& reader, std::uint32_t part) {
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

std::multiset<std::string> prints_of(const Gaussians4D& set) {
  const auto prints = fingerprints(set);
  return {prints.begin(), prints.end()};
}

// Finalizes what lost nothing; what is being written behind it is left out.
void finalize_whole(const std::string& path, const std::string& finished) {
  DamageReport losses;
  const Status status = finalize_scene(std::move(*open_file(path)), finished, losses);
  INFO(status.message());
  REQUIRE(status.ok());
  CHECK(losses.damage.empty());
  CHECK(losses.reason.ok());
}

pid_t spawn(const std::string& path, int count, int milliseconds) {
  std::string words[4] = {STGS_RECORD_STRETCHES, path, std::to_string(count),
                          std::to_string(milliseconds)};
  char* arguments[5] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(),
                        nullptr};
  pid_t pid = 0;
  REQUIRE(::posix_spawn(&pid, words[0].c_str(), nullptr, nullptr, arguments, environ) == 0);
  return pid;
}

// Waits until a file has so many bytes.
void wait_for(const std::string& path, std::uint64_t bytes) {
  std::error_code none;
  for (int i = 0; i < 30000 && !(fs::exists(path, none) && fs::file_size(path, none) >= bytes);
       ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace

TEST_CASE("a recording can be read after each stretch, and finalize makes what a writer writes") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  CHECK(opened(path)->primitives() == 0);
  Scene scene;
  scene.metadata = recording_metadata();
  for (std::uint32_t i = 0; i < 7; ++i) {
    const Gaussians4D set = stretch(i);
    REQUIRE((*recorder)->append(set, (i + 1) * kStretchFrames).ok());
    scene.gaussians.sh_degree = set.sh_degree;
    for (std::size_t k = 0; k < set.size(); ++k) scene.gaussians.append(set, k);
    scene.parts.push_back({10.0 * i, 10.0 * (i + 1), set.size()});
    const auto reader = opened(path);
    CHECK(reader->form() == SceneForm::kGrowing);
    CHECK(reader->incomplete_bytes() == 0);
    CHECK(reader->metadata().frames == (i + 1) * kStretchFrames);
    REQUIRE(reader->parts() == scene.parts);
    for (std::uint32_t p = 0; p <= i; ++p) CHECK(prints_of(*reader, p) == prints_of(stretch(p)));
    CHECK(issues_of(bytes_of(path)).empty());
  }
  REQUIRE((*recorder)->close().ok());
  CHECK(opened(path)->form() == SceneForm::kRecorded);
  CHECK(opened(path)->parts() == scene.parts);
  CHECK(issues_of(bytes_of(path)).empty());

  const std::string finished = folder / "finished.stgs";
  finalize_whole(path, finished);
  scene.metadata.frames = 70;
  WriteSettings settings = recording_settings().write;
  settings.own_layouts = true;
  const auto direct = encode_scene(scene, settings);
  REQUIRE(direct.ok());
  CHECK(bytes_of(finished) == *direct);
  CHECK(opened(finished)->form() == SceneForm::kFinished);
  DamageReport losses;
  CHECK(finalize_scene(std::move(*open_file(finished)), folder / "x.stgs", losses).code() ==
        StatusCode::kUsage);
  CHECK_FALSE(fs::exists(folder / "x.stgs"));
}

TEST_CASE("what is known to stay is recorded once, and is there as long as it was said to be") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  Gaussians4D room = stretch(0);
  std::fill(room.time.begin(), room.time.end(), 15.0f);
  std::fill(room.radius.begin(), room.radius.end(), 20.0f);  // frames 0 to 35
  REQUIRE((*recorder)->append(room, 10, {}, 35).ok());
  CHECK((*recorder)->frames() == 10);
  REQUIRE((*recorder)->append(stretch(1), 20).ok());
  recorder->reset();
  recorder = SceneRecorder::resume(path, recording_settings());
  REQUIRE(recorder.ok());
  CHECK((*recorder)->append(stretch(2), 20, {}, 100).code() == StatusCode::kUsage);
  for (std::uint32_t i = 2; i < 5; ++i) {
    REQUIRE((*recorder)->append(stretch(i), 10 * (i + 1), {}, 1).ok());
  }
  REQUIRE((*recorder)->close().ok());

  const std::string finished = folder / "finished.stgs";
  finalize_whole(path, finished);
  for (const std::string& file : {path, finished}) {
    const auto reader = opened(file);
    CHECK(reader->metadata().frames == 50);
    CHECK(reader->primitives() == 5 * 60);
    CHECK(reader->parts()[0] == ScenePart{0, 35, 60});
    CHECK(reader->parts()[1] == ScenePart{10, 20, 60});
    CHECK(prints_of(*reader, 0) == prints_of(room));
    const auto needs_room = [&reader](double moment) {
      const std::vector<std::uint32_t> needed = reader->segments_between(moment, moment);
      return std::any_of(needed.begin(), needed.end(),
                         [&](std::uint32_t s) { return reader->segments()[s].part == 0; });
    };
    CHECK(needs_room(34.9));
    CHECK_FALSE(needs_room(35));
    CHECK(issues_of(bytes_of(file)).empty());
  }
}

TEST_CASE("finalize keeps what it does not know") {
  const TemporaryFolder folder;
  const std::string vectors = std::string(STGS_TEST_DATA) + "/../conformance/vectors/";
  for (const char* name : {"growing_timed_data", "growing_with_further_records",
                           "growing_with_layouts", "growing_lasting", "growing_eight"}) {
    INFO(name);
    const std::string path = vectors + name + ".stgs", finished = folder / "finished.stgs";
    finalize_whole(path, finished);
    const auto recorded = opened(path), reader = opened(finished);
    Bytes before = bytes_of(path);
    const Bytes after = bytes_of(finished);
    before.resize(recorded->file_bytes());  // what follows is being written
    CHECK(issues_of(before).empty());
    CHECK(issues_of(after).empty());
    CHECK(reader->form() == SceneForm::kFinished);
    CHECK(reader->metadata().frames == recorded->metadata().frames);
    REQUIRE(reader->parts() == recorded->parts());
    for (std::uint32_t p = 0; p < reader->parts().size(); ++p) {
      CHECK(prints_of(*reader, p) == prints_of(*recorded, p));
    }
    const auto count = [](const Bytes& bytes, std::string_view text) {
      int found = 0;
      for (auto at = bytes.begin(); at != bytes.end(); ++found) {
        at = std::search(at, bytes.end(), text.begin(), text.end());
        if (at == bytes.end()) break;
        ++at;
      }
      return found;
    };
    for (const char* text : {"SEGM", "PRIV", "POSE", "audio/opus", "LAYT"}) {
      CHECK(count(without_copy(after), text) == count(before, text));
    }
    CHECK(count(after, "FRAG") == 0);
  }
}

TEST_CASE("a recording goes on with its copy, and finalize writes another") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", finished = folder / "finished.stgs";
  record(path, 0, false);
  const Bytes fresh = bytes_of(path);
  CHECK(issues_of(fresh).empty());
  CHECK(opened(path)->incomplete_bytes() == 0);
  {
    auto recorder = SceneRecorder::resume(path, recording_settings());
    REQUIRE(recorder.ok());
    REQUIRE((*recorder)->append(stretch(0), kStretchFrames).ok());
    REQUIRE((*recorder)->append(stretch(1), 2 * kStretchFrames).ok());
    REQUIRE((*recorder)->close().ok());
  }
  Bytes bytes = bytes_of(path);
  REQUIRE(std::equal(fresh.begin(), fresh.end(), bytes.begin()));
  CHECK(issues_of(bytes).empty());
  bytes[kHeaderBytes + 50] ^= 1;
  {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }
  DamageReport losses;
  REQUIRE(finalize_scene(std::move(*open_file(path)), finished, losses).ok());
  CHECK(losses.reason.ok());
  REQUIRE(losses.damage.size() == 1);
  CHECK(losses.damage[0].number == 118);
  const Bytes whole = bytes_of(finished);
  CHECK(issues_of(whole).empty());
  CHECK(copy_at(whole) < whole.size());
  CHECK(opened(finished)->primitives() == 120);
}

TEST_CASE("nothing is cut off a recording whose last stretch cannot be reached") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  record(path, 1, false);
  Bytes bytes = bytes_of(path);
  const auto sound = opened(path);
  for (const SegmentInfo& segment : sound->segments()) bytes[segment.offset + 9] ^= 1;
  {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }
  CHECK(opened(path)->primitives() == 0);
  CHECK(opened(path)->unreached_frames() == kStretchFrames);
  const auto recorder = SceneRecorder::resume(path, recording_settings());
  CHECK(recorder.status().code() == StatusCode::kInvalidFile);
  CHECK(bytes_of(path) == bytes);
}

TEST_CASE("a recording cut anywhere is read up to its last complete stretch") {
  const TemporaryFolder folder;
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const std::string path = folder / profile_name(profile);
    const std::vector<std::uint64_t> sizes = record(path, 5, true, profile, 6);
    const Bytes whole = bytes_of(path);
    REQUIRE(whole.size() == sizes.back());
    for (std::size_t size = 0; size <= whole.size(); ++size) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      const auto reader = SceneReader::open(memory_source(cut));
      if (size < sizes.front()) {  // the head, and its copy, which may be missing
        const bool opens = size >= head_of(whole).header.head_bytes;
        const auto code = opens ? StatusCode::kOk : StatusCode::kInvalidFile;
        if (reader.status().code() != code) FAIL("opened " << size << " bytes");
        continue;
      }
      std::size_t complete = 0;
      while (complete + 1 < sizes.size() && sizes[complete + 1] <= size) ++complete;
      const bool closed = complete == 6;
      const std::size_t stretches = closed ? 5 : complete;
      const std::uint64_t rest = size - sizes[complete];
      if (!reader.ok() || (*reader)->incomplete_bytes() != rest ||
          (*reader)->primitives() != 6 * stretches ||
          (*reader)->form() != (closed ? SceneForm::kRecorded : SceneForm::kGrowing)) {
        FAIL(size << " bytes: " << reader.status().message());
      }
      const std::set<int> expected = rest > 0 ? std::set<int>{314} : std::set<int>{};
      if (issues_of(cut) != expected) FAIL(size << " bytes: other issues");
      if (stretches > 0 && (rest < 2 || rest == 40)) {
        const auto scene = read_scene(memory_source(cut));
        if (!scene.ok() || scene->gaussians.size() != 6 * stretches) FAIL("cannot read " << size);
      }
    }
  }
}

TEST_CASE("every changed byte of a recording is found") {
  const TemporaryFolder folder;
  for (const bool close : {false, true}) {
    const std::string path = folder / (close ? "closed" : "open");
    record(path, 3, close, Profile::kQuantised, 5);
    const Bytes whole = bytes_of(path);
    for (std::size_t at = 0; at < whole.size(); ++at) {
      for (const int flip : {0x01, 0x80}) {
        Bytes damaged = whole;
        damaged[at] = static_cast<std::uint8_t>(damaged[at] ^ flip);
        if (issues_of(damaged).empty()) FAIL("byte " << at << " ^ " << flip);
      }
    }
  }
}

TEST_CASE("a recording that was cut anywhere is gone on with to the same bytes") {
  const TemporaryFolder folder;
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const std::string path = folder / profile_name(profile);
    const auto sizes = record(path, 9, true, profile, 6);
    const Bytes whole = bytes_of(path);
    std::vector<std::size_t> cuts(sizes.begin(), sizes.end() - 1);
    std::uint32_t state = 5;
    for (int i = 0; i < 40; ++i) {
      state = state * 1664525 + 1013904223;
      cuts.push_back(sizes.front() + state % (whole.size() - sizes.front()));
    }
    for (const std::size_t size : cuts) {
      const std::string cut = folder / "cut.stgs";
      REQUIRE(write_file_atomically(cut, std::span(whole).first(size)).ok());
      {
        auto recorder = SceneRecorder::resume(cut, recording_settings(profile));
        INFO(size << " of " << whole.size() << " bytes: " << recorder.status().message());
        REQUIRE(recorder.ok());
        std::size_t complete = 0;
        while (complete + 1 < sizes.size() - 1 && sizes[complete + 1] <= size) ++complete;
        REQUIRE((*recorder)->frames() == complete * kStretchFrames);
        CHECK((*recorder)->bytes() == sizes[complete]);
        CHECK(SceneRecorder::resume(cut, recording_settings(profile)).status().code() ==
              StatusCode::kUsage);  // one at a time
        for (auto i = static_cast<std::uint32_t>(complete); i < 9; ++i) {
          REQUIRE((*recorder)->append(stretch(i, 6), (i + 1) * kStretchFrames).ok());
        }
        REQUIRE((*recorder)->close().ok());
      }
      if (bytes_of(cut) != whole) FAIL("other bytes after a cut at " << size);
    }
    CHECK(SceneRecorder::resume(path, recording_settings(profile)).status().code() ==
          StatusCode::kUsage);
  }
}

TEST_CASE("a recording is gone on with after a kill, and after a power cut") {
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
  const std::uint32_t next = frames / kStretchFrames;
  REQUIRE((*recorder)->append(stretch(next), frames + kStretchFrames).ok());
  recorder->reset();
  CHECK(prints_of(*opened(path), next).size() == 60);
  CHECK(issues_of(bytes_of(path)).empty());

  // Bytes of the last stretch that did not reach the disk, though its fragment did.
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

TEST_CASE("a reader follows a file that another process writes") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const pid_t writer = spawn(path, 12, 5);
  wait_for(path, 300);
  auto reader = opened(path);
  std::set<std::uint32_t> seen;
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
    seen.insert(reader->metadata().frames);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  int status = -1;
  REQUIRE(::waitpid(writer, &status, 0) == writer);
  CHECK(status == 0);
  CHECK(reader->form() == SceneForm::kRecorded);
  CHECK(reader->metadata().frames == 120);
  CHECK(reader->primitives() == 12 * 60);
  CHECK(seen.size() > 3);
  CHECK_FALSE(*reader->refresh());
}

TEST_CASE("what was appended before a kill can be read and finalized") {
  const TemporaryFolder folder;
  const std::string reference = folder / "reference.stgs";
  record(reference, 40, false, Profile::kQuantised);
  const auto expected = opened(reference);
  for (const std::uint64_t bytes : {1u, 2000u, 9000u, 20000u, 40001u}) {
    const std::string path = folder / fmt::format("killed{}.stgs", bytes);
    const pid_t writer = spawn(path, 100000, 0);
    wait_for(path, bytes);
    REQUIRE(::kill(writer, SIGKILL) == 0);
    int status = 0;
    REQUIRE(::waitpid(writer, &status, 0) == writer);
    CHECK(WIFSIGNALED(status));
    const auto reader = SceneReader::open(path);
    if (bytes < 10) {  // perhaps within the head
      CHECK((reader.ok() || reader.status().code() == StatusCode::kInvalidFile));
      continue;
    }
    REQUIRE(reader.ok());
    CHECK((*reader)->form() == SceneForm::kGrowing);
    const auto parts = static_cast<std::uint32_t>((*reader)->parts().size());
    REQUIRE(parts >= 1);
    for (std::uint32_t p = 0; p < std::min(parts, 40u); ++p) {
      CHECK(prints_of(**reader, p) == prints_of(*expected, p));
    }
    const std::string finished = folder / fmt::format("finished{}.stgs", bytes);
    finalize_whole(path, finished);
    CHECK(opened(finished)->parts().size() == parts);
    CHECK(issues_of(bytes_of(finished)).empty());
  }
}

TEST_CASE("a recorder says what it cannot do") {
  const TemporaryFolder folder;
  const std::string path = folder / "a.stgs";
  const RecordSettings settings = recording_settings();
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, settings);
  REQUIRE(recorder.ok());
  CHECK(SceneRecorder::create(path, recording_metadata(), 1, settings).status().code() ==
        StatusCode::kIo);
  CHECK(SceneRecorder::create(folder / "no/b", recording_metadata(), 1, settings).status().code() ==
        StatusCode::kIo);
  SceneMetadata metadata = recording_metadata();
  metadata.time_base = {0, 30};
  CHECK(SceneRecorder::create(folder / "c", metadata, 1, settings).status().code() ==
        StatusCode::kUsage);
  metadata = recording_metadata();
  metadata.window = CaptureWindow{0, 1, 0, 0};
  CHECK(SceneRecorder::create(folder / "c", metadata, 1, settings).status().code() ==
        StatusCode::kUsage);
  CHECK_FALSE(fs::exists(folder / "c"));
  CHECK((*recorder)->append(stretch(0), 0).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(stretch(0, 5, 0), 10).code() == StatusCode::kUsage);
  Gaussians4D broken = stretch(0);
  broken.sigma[3] = NAN;
  CHECK((*recorder)->append(broken, 10).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(stretch(0), 10, std::vector<float>(3)).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(stretch(0), 10).ok());
  CHECK((*recorder)->append(stretch(0), 10).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(stretch(0, 0), 20).ok());  // nothing is seen there
  CHECK(opened(path)->metadata().frames == 20);
  CHECK((*recorder)->close().ok());
  CHECK((*recorder)->close().code() == StatusCode::kUsage);
  CHECK((*recorder)->append(stretch(1), 30).code() == StatusCode::kUsage);
  CHECK(issues_of(bytes_of(path)).empty());
  Bytes more = bytes_of(path);
  more.push_back(0);
  const auto longer = SceneReader::open(memory_source(more));
  REQUIRE(longer.ok());
  REQUIRE((*longer)->damage().size() == 1);
  CHECK((*longer)->damage()[0].number == 106);
}
