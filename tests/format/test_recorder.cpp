// SPDX-License-Identifier: Apache-2.0
// Recording: appending, closing, reading while recording, and finalizing.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>

#include "catch.h"
#include "fixtures/recording_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

TEST_CASE("a recording is readable after each fragment, and finalize gives the writer's body") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  CHECK(open_scene(path)->primitives() == 0);
  Scene scene;
  scene.metadata = recording_metadata();
  for (std::uint32_t i = 0; i < 7; ++i) {
    const Gaussians4D set = make_fragment(i);
    REQUIRE((*recorder)->append(set, (i + 1) * kFragmentFrames).ok());
    scene.gaussians.sh_degree = set.sh_degree;
    for (std::size_t k = 0; k < set.size(); ++k) scene.gaussians.append(set, k);
    scene.parts.push_back({10.0 * i, 10.0 * (i + 1), set.size()});
    const auto reader = open_scene(path);
    CHECK(reader->form() == SceneForm::kGrowing);
    CHECK(reader->incomplete_bytes() == 0);
    CHECK(reader->metadata().frames == (i + 1) * kFragmentFrames);
    REQUIRE(reader->parts() == scene.parts);
    for (std::uint32_t p = 0; p <= i; ++p)
      CHECK(fingerprints_of(*reader, p) == fingerprints_of(make_fragment(p)));
    CHECK(issues_of(bytes_of(path)).empty());
  }
  REQUIRE((*recorder)->close().ok());
  CHECK(open_scene(path)->form() == SceneForm::kRecorded);
  CHECK(open_scene(path)->parts() == scene.parts);
  CHECK(issues_of(bytes_of(path)).empty());

  const std::string finished = folder / "finished.stgs";
  finalize_intact(path, finished);
  scene.metadata.frames = 70;
  WriteSettings settings = recording_settings().write;
  settings.own_layouts = true;
  const auto direct = encode_scene(scene, settings);
  REQUIRE(direct.ok());
  CHECK(body_of(bytes_of(finished)) == body_of(*direct));
  CHECK(open_scene(finished)->form() == SceneForm::kFinished);
  DamageReport report;
  CHECK(finalize_scene(std::move(*open_file(finished)), folder / "x.stgs", report).code() ==
        StatusCode::kUsage);
  CHECK_FALSE(fs::exists(folder / "x.stgs"));
}

TEST_CASE("a fragment that stays visible is recorded once and lasts as long as stated") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  Gaussians4D lasting = make_fragment(0);
  std::fill(lasting.time.begin(), lasting.time.end(), 15.0f);
  std::fill(lasting.radius.begin(), lasting.radius.end(), 20.0f);  // visible in frames 0 to 35
  REQUIRE((*recorder)->append(lasting, 10, {}, 35).ok());
  CHECK((*recorder)->frames() == 10);
  REQUIRE((*recorder)->append(make_fragment(1), 20).ok());
  recorder->reset();
  recorder = SceneRecorder::resume(path, recording_settings());
  REQUIRE(recorder.ok());
  CHECK((*recorder)->append(make_fragment(2), 20, {}, 100).code() == StatusCode::kUsage);
  for (std::uint32_t i = 2; i < 5; ++i) {
    REQUIRE((*recorder)->append(make_fragment(i), 10 * (i + 1), {}, 1).ok());
  }
  REQUIRE((*recorder)->close().ok());

  const std::string finished = folder / "finished.stgs";
  finalize_intact(path, finished);
  for (const std::string& file : {path, finished}) {
    const auto reader = open_scene(file);
    CHECK(reader->metadata().frames == 50);
    CHECK(reader->primitives() == 5 * 60);
    CHECK(reader->parts()[0] == ScenePart{0, 35, 60});
    CHECK(reader->parts()[1] == ScenePart{10, 20, 60});
    CHECK(fingerprints_of(*reader, 0) == fingerprints_of(lasting));
    const auto needs_lasting = [&reader](double time) {
      const std::vector<std::uint32_t> needed = reader->segments_between(time, time);
      return std::any_of(needed.begin(), needed.end(),
                         [&](std::uint32_t s) { return reader->segments()[s].part == 0; });
    };
    CHECK(needs_lasting(34.9));
    CHECK_FALSE(needs_lasting(35));
    CHECK(issues_of(bytes_of(file)).empty());
  }
}

TEST_CASE("the parts of a fragment are displayed for times of their own") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  Gaussians4D lasting = make_fragment(7);
  std::fill(lasting.radius.begin(), lasting.radius.end(), 1000.0f);
  const Gaussians4D none = make_fragment(0, 0), second = make_fragment(1);
  const Gaussians4D brief = make_fragment(0);
  const FragmentPart first[] = {{brief}, {lasting, {}, 500}};
  REQUIRE((*recorder)->append(first, 10).ok());
  const FragmentPart then[] = {{none}, {second}, {lasting, {}, 100}};
  REQUIRE((*recorder)->append(then, 20).ok());
  Gaussians4D other = second;
  other.sh_degree = 0;
  const FragmentPart mixed[] = {{second}, {other}};
  CHECK((*recorder)->append(mixed, 30).code() == StatusCode::kUsage);
  CHECK((*recorder)->primitives() == 4 * 60);
  REQUIRE((*recorder)->append(second, 30).ok());
  REQUIRE((*recorder)->close().ok());

  const std::string finished = folder / "finished.stgs";
  finalize_intact(path, finished);
  for (const std::string& file : {path, finished}) {
    const auto reader = open_scene(file);
    CHECK(reader->parts() ==
          std::vector<ScenePart>{
              {0, 10, 60}, {0, 500, 60}, {10, 20, 60}, {10, 100, 60}, {20, 30, 60}});
    CHECK(fingerprints_of(*reader, 1) == fingerprints_of(lasting));
    CHECK(fingerprints_of(*reader, 2) == fingerprints_of(second));
    std::set<std::uint32_t> needed;
    for (const std::uint32_t s : reader->segments_between(25, 25))
      needed.insert(reader->segments()[s].part);
    CHECK(needed == std::set<std::uint32_t>{1, 3, 4});
    CHECK(issues_of(bytes_of(file)).empty());
  }
}

namespace {

// The bytes of a recording without its FRAG records, which contain copies of the head.
Bytes without_fragments(const Bytes& bytes) {
  Bytes out;
  for (std::size_t at = kHeader; at < bytes.size();) {
    const std::size_t end = at + kRecord + get<std::uint64_t>(bytes, at + 8);
    REQUIRE(end <= bytes.size());
    if (get<std::uint32_t>(bytes, at) != kFragmentTag)
      out.insert(out.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                 bytes.begin() + static_cast<std::ptrdiff_t>(end));
    at = end;
  }
  return out;
}

}  // namespace

TEST_CASE("finalize preserves unknown records") {
  const TemporaryFolder folder;
  const std::string vectors = std::string(STGS_TEST_DATA) + "/../conformance/vectors/";
  for (const char* name : {"growing_further_records", "growing_17", "growing_lasting",
                           "growing_links", "growing_eight_deep"}) {
    INFO(name);
    const std::string path = vectors + name + ".stgs", finished = folder / "finished.stgs";
    finalize_intact(path, finished);
    const auto recorded = open_scene(path), reader = open_scene(finished);
    Bytes before = bytes_of(path);
    const Bytes after = bytes_of(finished);
    before.resize(recorded->file_bytes());  // without the incomplete end
    CHECK(issues_of(before).empty());
    CHECK(issues_of(after).empty());
    CHECK(reader->form() == SceneForm::kFinished);
    CHECK(reader->metadata().frames == recorded->metadata().frames);
    REQUIRE(reader->parts() == recorded->parts());
    for (std::uint32_t p = 0; p < reader->parts().size(); ++p) {
      CHECK(fingerprints_of(*reader, p) == fingerprints_of(*recorded, p));
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
      CHECK(count(without_copy(after), text) == count(without_fragments(before), text));
    }
    CHECK(count(after, "FRAG") == 0);
  }
}

TEST_CASE("each fragment has a copy of the head, and finalize writes one") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", finished = folder / "finished.stgs";
  record(path, 0, false);
  const Bytes fresh = bytes_of(path);
  CHECK(issues_of(fresh).empty());
  CHECK(open_scene(path)->incomplete_bytes() == 0);
  {
    auto recorder = SceneRecorder::resume(path, recording_settings());
    REQUIRE(recorder.ok());
    REQUIRE((*recorder)->append(make_fragment(0), kFragmentFrames).ok());
    REQUIRE((*recorder)->append(make_fragment(1), 2 * kFragmentFrames).ok());
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
  DamageReport report;
  REQUIRE(finalize_scene(std::move(*open_file(path)), finished, report).ok());
  CHECK(report.reason.ok());
  REQUIRE(report.damage.size() == 1);
  CHECK(report.damage[0].number == 118);
  const Bytes finalized = bytes_of(finished);
  CHECK(issues_of(finalized).empty());
  CHECK(copy_at(finalized) < finalized.size());
  CHECK(open_scene(finished)->primitives() == 120);
}

TEST_CASE("a recorder rejects invalid calls") {
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
  CHECK((*recorder)->append(make_fragment(0), 0).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(make_fragment(0, 5, 0), 10).code() == StatusCode::kUsage);
  Gaussians4D broken = make_fragment(0);
  broken.sigma[3] = NAN;
  CHECK((*recorder)->append(broken, 10).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(make_fragment(0), 10, std::vector<float>(3)).code() ==
        StatusCode::kUsage);
  CHECK((*recorder)->append(make_fragment(0), 10).ok());
  CHECK((*recorder)->append(make_fragment(0), 10).code() == StatusCode::kUsage);
  CHECK((*recorder)->append(make_fragment(0, 0), 20).ok());  // a fragment without primitives
  CHECK(open_scene(path)->metadata().frames == 20);
  CHECK((*recorder)->close().ok());
  CHECK((*recorder)->close().code() == StatusCode::kUsage);
  CHECK((*recorder)->append(make_fragment(1), 30).code() == StatusCode::kUsage);
  CHECK(issues_of(bytes_of(path)).empty());
  Bytes more = bytes_of(path);
  more.push_back(0);
  const auto longer = SceneReader::open(memory_source(more));
  REQUIRE(longer.ok());
  REQUIRE((*longer)->damage().size() == 1);
  CHECK((*longer)->damage()[0].number == 106);
}
