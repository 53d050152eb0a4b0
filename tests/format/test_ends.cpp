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
#include "stgs/format/output_file.h"

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
    CHECK(reader->latest_begin_ticks() == 0);  // that of the first fragment
    CHECK(reader->ended_segments({}) == std::vector<std::uint32_t>{0});
    CHECK(reader->ended_segments(reader->end_records()).empty());
    CHECK(issues_of(bytes_of(file)).empty());
    CHECK((head_of(bytes_of(file)).header.flags & kHasEnds) != 0);
    const auto scene = read_scene(file);
    REQUIRE(scene.ok());
    CHECK(scene->parts == std::vector<ScenePart>{{0, 1000, 60}});
  }
}

TEST_CASE("a recording without ends has a flag for them until it is finished") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", finished = folder / "finished.stgs";
  const auto recorder = create(path, settings_with_ends());
  append(*recorder, {}, {}, 10);
  REQUIRE(recorder->close().ok());
  CHECK(head_of(bytes_of(path)).header.flags == (kGrowing | kHasEnds));
  finalize_intact(path, finished);
  CHECK(head_of(bytes_of(finished)).header.flags == 0);
}

namespace {

// The offset of a record of ends in a recording.
std::uint64_t end_record_in(const std::string& path, std::size_t number) {
  return open_scene(path)->end_records().at(number);
}

void write(const std::string& path, const Bytes& bytes) {
  REQUIRE(write_file_atomically(path, bytes).ok());
}

void flip(const std::string& path, std::uint64_t at) {
  Bytes bytes = bytes_of(path);
  bytes.at(at) ^= 1;
  write(path, bytes);
}

}  // namespace

TEST_CASE("primitives whose ends are damaged are displayed for longer, and it is reported") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", finished = folder / "finished.stgs";
  EndedRecording recording;
  recording.write(path, settings_with_ends(), false);
  flip(path, end_record_in(path, 1) + kRecordHeaderBytes + 10);
  const auto reader = open_scene(path);
  REQUIRE(reader->damage().size() == 1);
  CHECK(reader->damage().front().number == 319);
  CHECK(reader->end_records().size() == 1);
  const auto visible = visible_at(*reader, 0, 15);
  CHECK(std::all_of(visible.begin(), visible.end(), [](const auto& one) { return one.second; }));
  CHECK(issues_of(bytes_of(path)).count(319) == 1);
  // Other records are copied as they are, damaged ones too.
  DamageReport report;
  REQUIRE(finalize_scene(std::move(*open_file(path)), finished, report).ok());
  CHECK(report.further == 1);
  CHECK(open_scene(finished)->damage().size() == 1);
}

TEST_CASE("a recording is resumed before a fragment whose ends a power failure damaged") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  EndedRecording recording;
  const std::vector<std::uint64_t> bytes = recording.write(path, settings_with_ends(), false);
  Bytes open = bytes_of(path);
  open.resize(bytes[3]);  // without the FRAG record of close()
  write(path, open);
  const std::uint64_t last = open_scene(path)->end_records().front();
  flip(path, last + kRecordHeaderBytes + 10);
  const auto resumed = SceneRecorder::resume(path, recording_settings());
  INFO(resumed.status().message());
  REQUIRE(resumed.ok());
  CHECK((*resumed)->frames() == 30);
  CHECK((*resumed)->bytes() == bytes[2]);
}

TEST_CASE("records of ends are bounded before they are read") {
  const IndexEntry entry = [] {
    IndexEntry ends;
    ends.level = -1;
    ends.layer = layer_of(Content::kEnds, 0);
    return ends;
  }();
  EndList list{{0, 0, 0}, 3, std::vector<std::uint32_t>(kMaxEnds)};
  for (std::uint32_t i = 0; i < kMaxEnds; ++i) list.primitives[i] = i;
  const auto is_valid = [&](std::span<const EndList> lists) {
    std::vector<EndList> parsed;
    Findings findings;
    const bool good = parse_ends(write_ends(entry, lists), entry, 0, parsed, findings);
    CHECK(good == findings.ok());
    return good;
  };
  CHECK(is_valid({&list, 1}));
  const EndList more{{0, 0, 0}, 4, {7}};
  const EndList both[] = {list, more};
  CHECK_FALSE(is_valid(both));

  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  EndedRecording recording;
  recording.write(path, settings_with_ends(), false);
  const std::vector<PrimitiveEnd> many(kMaxEnds + 1, {recording.stored[0][0], 5});
  const auto recorder = create(folder / "many.stgs", settings_with_ends());
  CHECK(recorder->append({}, many, 10).code() == StatusCode::kUsage);
  // The index takes less than this limit, the ends with it do not.
  ReadLimits limits;
  limits.max_opening = head_of(bytes_of(path)).walk.opening_bytes;
  CHECK(SceneReader::open(path, limits).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("all ways to decode a segment end its primitives") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto recorder = create(path, settings_with_ends(Profile::kQuantised));
  Gaussians4D moving = make_fragment(3, 5000);
  std::fill(moving.radius.begin(), moving.radius.end(), 40.0f);
  const FragmentPart parts[] = {{moving, {}, 1000}};
  Locations stored;
  append(*recorder, parts, {}, 10, &stored);
  const auto before = open_scene(path);
  std::vector<PrimitiveEnd> ends;
  for (std::size_t i = 0; i < moving.size(); i += 3) ends.push_back({stored[0][i], 15});
  append(*recorder, {}, ends, 20);
  const auto reader = open_scene(path);
  for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
    const auto unended = before->decode(s), set = reader->decode(s);
    REQUIRE(set.ok());
    Gaussians4D expected = *unended;
    apply_ends(reader->ends(s), 0, expected);
    CHECK(set->time == expected.time);
    CHECK(set->radius == expected.radius);
    CHECK(set->position == expected.position);
    const auto placement = reader->decode_placement(s);
    REQUIRE(placement.ok());
    CHECK(placement->position == expected.position);
    CHECK(placement->time == expected.time);
    const Status passed = reader->decode_ranges(
        s, true, TimeOrigin::kPart, [&](const Gaussians4D& window, std::size_t begin) {
          CHECK(std::equal(window.time.begin(), window.time.end(), expected.time.begin() + begin));
        });
    CHECK(passed.ok());
    const auto coded = reader->read(s, true);
    REQUIRE(coded.ok());
    CHECK(coded->ends.size() == reader->ends(s).size());
    for (const SegmentEnd& end : reader->ends(s)) {
      // The path is the same, up to rounding; the flat top ends with the end.
      const std::size_t i = end.primitive;
      const float end_of_top = expected.time[i] + expected.radius[i];
      CHECK(end_of_top <= 15.001f);
      for (std::size_t c = 3 * i; c < 3 * i + 3; ++c) {
        CHECK(expected.position[c] - expected.velocity[c] * expected.time[i] ==
              Approx(unended->position[c] - unended->velocity[c] * unended->time[i]).margin(1e-4));
      }
    }
  }
}

TEST_CASE("an ended lifespan has its end and its beginning, and never grows") {
  const auto ended = [](float time, float radius, float begin, float end) {
    const math::Lifespan out = math::ended_lifespan(time, radius, begin, end);
    return std::pair(out.time - out.radius, out.time + out.radius);
  };
  using Top = std::pair<float, float>;
  CHECK(ended(10, 4, 0, 12) == Top(6, 12));
  CHECK(ended(10, 4, 0, 14) == Top(6, 14));
  CHECK(ended(10, 4, 0, 99) == Top(6, 14));   // it ends by itself
  CHECK(ended(10, 4, 0, 3) == Top(6, 6));     // before it begins
  CHECK(ended(10, 40, 0, 12) == Top(0, 12));  // it began before its part
  CHECK(ended(10, 40, -5, 12) == Top(-5, 12));
  CHECK(ended(-10, 4, 0, 3) == Top(-14, -6));  // before its part
  // A lifespan that is much longer than the recording keeps the precision of the end.
  const math::Lifespan precise = math::ended_lifespan(5e8f, 1e9f, 0, 123457);
  CHECK(precise.time + precise.radius == 123457.0f);
}
