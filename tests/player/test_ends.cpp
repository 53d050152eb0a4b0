// SPDX-License-Identifier: Apache-2.0
// Playback of primitives that end (spec 5.9): ends that are known before their segment is decoded,
// and ends that arrive later.
#include "live_fixture.h"

namespace stgs::player {
namespace {

using namespace live;

constexpr std::uint32_t kEndFrame = 23;  // of half of the primitives

// Primitives that last longer than the recording, half of which end in the fourth fragment. [i]:
// file size with i complete fragments.
Recording recording_with_ends() {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  RecordSettings settings = testing::recording_settings(Profile::kQuantised);
  settings.ends = true;
  auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1, settings);
  REQUIRE(recorder.ok());
  Gaussians4D still = testing::make_fragment(5, 200);
  std::fill(still.radius.begin(), still.radius.end(), 2000.0f);
  std::fill(still.sigma.begin(), still.sigma.end(), 1.0f);
  std::fill(still.velocity.begin(), still.velocity.end(), 0.0f);
  Recording out;
  out.ends.push_back((*recorder)->bytes());
  std::vector<std::vector<StoredPrimitive>> stored;
  const FragmentPart parts[] = {{still, {}, 1000}};
  REQUIRE((*recorder)->append(parts, {}, testing::kFragmentFrames, &stored).ok());
  out.ends.push_back((*recorder)->bytes());
  std::vector<PrimitiveEnd> ends;
  for (std::size_t i = 0; i < still.size(); i += 2) ends.push_back({stored[0][i], kEndFrame});
  for (std::uint32_t i = 1; i < 5; ++i) {
    const std::span<const PrimitiveEnd> own = i == 3 ? ends : std::span<const PrimitiveEnd>();
    REQUIRE((*recorder)->append({}, own, (i + 1) * testing::kFragmentFrames).ok());
    out.ends.push_back((*recorder)->bytes());
  }
  REQUIRE((*recorder)->close().ok());
  out.bytes = read_file(path);
  return out;
}

std::size_t active_at(Timeline& timeline, double frame) {
  return active_fingerprints(timeline, frame * kFrameSeconds).size();
}

std::unique_ptr<Timeline> timeline_of(const Bytes& bytes, IndexLoading loading) {
  auto reader =
      SceneReader::open(memory_source(bytes), {}, std::pmr::get_default_resource(), loading);
  REQUIRE(reader.ok());
  return Timeline::from_reader(std::move(*reader));
}

}  // namespace

TEST_CASE("a timeline ends primitives whether the ends or the segment are loaded first") {
  const Recording recording = recording_with_ends();
  const auto loading = GENERATE(IndexLoading::kComplete, IndexLoading::kOnDemand);
  const auto forwards = timeline_of(recording.bytes, loading);
  const auto backwards = timeline_of(recording.bytes, loading);
  for (const double frame : {0.0, 15.0, 22.0, 23.0, 49.0, 22.0})
    CHECK(active_at(*forwards, frame) == (frame <= 23 ? 200 : 100));
  for (const double frame : {49.0, 23.0, 0.0, 40.0})
    CHECK(active_at(*backwards, frame) == (frame <= 23 ? 200 : 100));
}

TEST_CASE("a viewer ends primitives that it displays once their ends arrive") {
  const Recording recording = recording_with_ends();
  Viewer viewer(0, quick(), recording.bytes);
  const auto active = [&](std::uint32_t frame) {
    REQUIRE(viewer.player->seek_frame(frame).ok());
    REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
    return active_at(viewer.player->timeline(), frame);
  };
  viewer.file->grow(recording.ends[3]);
  REQUIRE(viewer.wait_for_edge(3));
  CHECK(active(29) == 200);
  viewer.file->grow(recording.ends[4]);
  REQUIRE(viewer.wait_for_edge(4));
  CHECK(active(29) == 100);
  CHECK(active(22) == 200);
  CHECK(active(29) == 100);
  // The segment was read once.
  const SegmentInfo segment = viewer.player->timeline().reader().segments()[0];
  const auto reads = viewer.file->reads();
  CHECK(std::count_if(reads.begin(), reads.end(), [&](const Growth::Read& read) {
          return segment.offset <= read.offset && read.offset < segment.offset + segment.bytes;
        }) == 1);
}

TEST_CASE("a viewer that joins later loads the ends that concern its position") {
  const Recording recording = recording_with_ends();
  Viewer viewer(0, quick(), recording.bytes);
  viewer.file->grow(recording.ends[5]);
  REQUIRE(viewer.wait_for_edge(5));
  for (const std::uint32_t frame : {45u, 10u, 28u, 23u}) {
    REQUIRE(viewer.player->seek_frame(frame).ok());
    REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
    CHECK(active_at(viewer.player->timeline(), frame) == (frame <= 23 ? 200 : 100));
  }
}

}  // namespace stgs::player
