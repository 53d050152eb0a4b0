// SPDX-License-Identifier: Apache-2.0
// Ends of primitives that were recorded earlier (spec 5.9).
#include <algorithm>
#include <array>
#include <map>

#include "catch.h"
#include "container/ends.h"
#include "fixtures/recording_fixture.h"
#include "head_fixture.h"
#include "stgs/format/math/lifespan.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
using Locations = std::vector<std::vector<StoredPrimitive>>;

namespace {

RecordSettings settings_with_ends(Profile profile = Profile::kLossless, int tiers = 0) {
  RecordSettings settings = recording_settings(profile);
  settings.write.tiers = tiers;
  settings.ends = true;
  return settings;
}

// Static primitives that last longer than the recording.
Gaussians4D lasting(std::uint32_t seed, std::size_t primitives = 60) {
  Gaussians4D set = make_fragment(seed, primitives);
  std::fill(set.radius.begin(), set.radius.end(), 2000.0f);
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1.0f);
  std::fill(set.time.begin(), set.time.end(), 500.0f);
  return set;
}

std::unique_ptr<SceneRecorder> create(const std::string& path, const RecordSettings& settings) {
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, settings);
  INFO(recorder.status().message());
  REQUIRE(recorder.ok());
  return std::move(*recorder);
}

void append(SceneRecorder& recorder, std::span<const FragmentPart> parts,
            std::span<const PrimitiveEnd> ends, std::uint32_t end_frame,
            Locations* stored = nullptr) {
  const Status status = recorder.append(parts, ends, end_frame, stored);
  INFO(status.message());
  REQUIRE(status.ok());
}

}  // namespace

TEST_CASE("a recorder returns where primitives are stored") {
  const TemporaryFolder folder;
  const Profile profile = GENERATE(Profile::kLossless, Profile::kQuantised);
  const int tiers = GENERATE(1, 3);
  const std::string path = folder / "live.stgs";
  const auto recorder = create(path, settings_with_ends(profile, tiers));
  const Gaussians4D brief = make_fragment(0), still = lasting(1);
  const FragmentPart parts[] = {{brief}, {still, {}, 1000}};
  Locations stored;
  append(*recorder, parts, {}, 10, &stored);
  REQUIRE(stored.size() == 2);
  const auto reader = open_scene(path);
  for (std::size_t p = 0; p < 2; ++p) {
    const Gaussians4D& source = parts[p].primitives;
    REQUIRE(stored[p].size() == source.size());
    std::size_t found = 0;
    for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
      const auto set = reader->decode(s);
      REQUIRE(set.ok());
      for (std::size_t i = 0; i < source.size(); ++i) {
        if (stored[p][i].record != reader->segments()[s].offset) continue;
        REQUIRE(stored[p][i].index < set->size());
        ++found;
        const float x = set->position[3 * stored[p][i].index];
        CHECK(x == Approx(source.position[3 * i]).margin(0.05));
      }
    }
    CHECK(found == source.size());
  }
}

TEST_CASE("a recorder rejects ends of primitives that it did not record") {
  const TemporaryFolder folder;
  const Gaussians4D still = lasting(1);
  const FragmentPart parts[] = {{still, {}, 1000}};
  Locations stored;
  const auto without = create(folder / "without.stgs", recording_settings());
  append(*without, parts, {}, 10, &stored);
  const PrimitiveEnd end[] = {{stored[0][0], 12}};
  CHECK(without->append({}, end, 20).code() == StatusCode::kUsage);

  const auto recorder = create(folder / "live.stgs", settings_with_ends());
  append(*recorder, parts, {}, 10, &stored);
  const std::uint64_t bytes = recorder->bytes();
  const std::uint64_t record = stored[0][0].record;
  for (const PrimitiveEnd& wrong :
       {PrimitiveEnd{{record + 1, 0}, 12}, PrimitiveEnd{{0, 0}, 12}, PrimitiveEnd{{record, 60}, 12},
        PrimitiveEnd{{record, 0}, 21}}) {
    Locations unchanged = stored;
    CHECK(recorder->append({}, {&wrong, 1}, 20, &unchanged).code() == StatusCode::kUsage);
    CHECK(unchanged == stored);
  }
  CHECK(recorder->bytes() == bytes);
  append(*recorder, {}, end, 20);
}

namespace {

// The primitives of all segments of a part, with whether they are visible at a time of the
// timeline, by the bits of their stored position.
std::map<std::array<float, 3>, bool> visible_at(const SceneReader& reader, std::uint32_t part,
                                                double ticks) {
  std::map<std::array<float, 3>, bool> out;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    if (reader.segments()[s].part != part) continue;
    const auto set = reader.decode(s);
    REQUIRE(set.ok());
    const double at = ticks - reader.parts()[part].begin_ticks;
    for (std::size_t i = 0; i < set->size(); ++i) {
      const auto dt = static_cast<float>(at - set->time[i]);
      const float* const x = &set->position[3 * i];
      out[{x[0], x[1], x[2]}] = math::visibility(dt, set->sigma[i], set->radius[i]) == 1.0f;
    }
  }
  return out;
}

// A recording whose first fragment has primitives that last; those at even indices end: at frame 23
// in the third fragment, and at frame 12 in the fourth one, if their index is a multiple of 4.
struct EndedRecording {
  Gaussians4D still = lasting(1);
  Locations stored;

  // Returns the bytes of the file after each fragment.
  std::vector<std::uint64_t> write(const std::string& path, const RecordSettings& settings,
                                   bool resume) {
    auto recorder = create(path, settings);
    const FragmentPart parts[] = {{still, {}, 1000}};
    append(*recorder, parts, {}, 10, &stored);
    std::vector<std::uint64_t> bytes = {recorder->bytes()};
    append(*recorder, {}, {}, 20);
    bytes.push_back(recorder->bytes());
    for (const auto& [step, frame, end_frame] :
         {std::array{2u, 23u, 30u}, std::array{4u, 12u, 40u}}) {
      if (resume) {
        recorder.reset();
        auto resumed = SceneRecorder::resume(path, recording_settings(settings.write.profile));
        REQUIRE(resumed.ok());
        recorder = std::move(*resumed);
      }
      std::vector<PrimitiveEnd> ends;
      for (std::size_t i = 0; i < still.size(); i += step) ends.push_back({stored[0][i], frame});
      append(*recorder, {}, ends, end_frame);
      bytes.push_back(recorder->bytes());
    }
    REQUIRE(recorder->close().ok());
    return bytes;
  }

  // Returns the time up to which primitive i of `still` is visible.
  static double end_of(std::size_t i) { return i % 4 == 0 ? 12 : i % 2 == 0 ? 23 : 1000; }

  void check(const SceneReader& reader) const {
    for (const double ticks : {0.0, 11.0, 12.0, 12.5, 22.5, 23.5, 39.0}) {
      const auto visible = visible_at(reader, 0, ticks);
      REQUIRE(visible.size() == still.size());
      for (std::size_t i = 0; i < still.size(); ++i) {
        const float* const x = &still.position[3 * i];
        INFO("primitive " << i << " at " << ticks);
        CHECK(visible.at({x[0], x[1], x[2]}) == (ticks <= end_of(i)));
      }
    }
  }
};

}  // namespace

TEST_CASE("primitives end in live and in finished files") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", finished = folder / "finished.stgs";
  EndedRecording recording;
  recording.write(path, settings_with_ends(), GENERATE(false, true));
  finalize_intact(path, finished);
  for (const std::string& file : {path, finished}) {
    const auto reader = open_scene(file);
    CHECK(reader->damage().empty());
    recording.check(*reader);
    CHECK(reader->end_records().size() == 2);
    CHECK(reader->ended_segments({}) == std::vector<std::uint32_t>{0});
    CHECK(reader->ended_segments(reader->end_records()).empty());
    CHECK(issues_of(bytes_of(file)).empty());
    CHECK((head_of(bytes_of(file)).header.flags & kHasEnds) != 0);
    const auto scene = read_scene(file);
    REQUIRE(scene.ok());
    CHECK(scene->parts == std::vector<ScenePart>{{0, 1000, 60}});
  }
}
