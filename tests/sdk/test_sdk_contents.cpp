// SPDX-License-Identifier: Apache-2.0
// The C interface states how a file is stored as the reader does, and computes its statistics.
#include <algorithm>
#include <fstream>
#include <iterator>

#include "sdk_fixture.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/decoder_model.h"
#include "stgs/format/scene_statistics.h"
#include "struct_sizes.h"

namespace stgs::testing {
namespace {

using Bytes = std::vector<std::uint8_t>;

template <typename T>
T sized() {
  T out{};
  out.struct_size = sizeof(T);
  return out;
}

// Three parts of 10 frames.
Bytes file_with_parts() {
  constexpr std::size_t kPrimitives = 12000;
  Scene scene = random_scene(kPrimitives, 1, 30, 5);
  for (int part = 0; part < 3; ++part) {
    scene.parts.push_back({10.0 * part, 10.0 * (part + 1), kPrimitives / 3, {}});
  }
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
    scene.gaussians.time[i] = static_cast<float>(i % 10);
    scene.importance.push_back(static_cast<float>(1 + i % 100));
  }
  scene.metadata.window = CaptureWindow{60, 120, 1, 2};
  scene.metadata.audio = "a.opus";
  scene.metadata.audio_begin = -15;
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 2;
  auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  return std::move(bytes).value();
}

// A recording that lacks the fragment that lists its second part.
Bytes file_with_lost_fragment() {
  std::ifstream file(STGS_TEST_DATA "/../conformance/vectors/fragment_damaged.stgs",
                     std::ios::binary);
  REQUIRE(file);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::unique_ptr<SceneReader> reader_of(const Bytes& file) {
  auto reader = SceneReader::open(memory_source(file, "memory"));
  REQUIRE(reader.ok());
  return std::move(reader).value();
}

stgs_contents contents_of(const ScenePtr& scene) {
  auto contents = sized<stgs_contents>();
  REQUIRE(stgs_scene_get_contents(scene.get(), &contents) == STGS_OK);
  return contents;
}

}  // namespace

TEST_CASE("parts, segments and streams are those of the file", "[sdk]") {
  const Bytes file = file_with_parts();
  const ScenePtr scene = open_scene(file);
  const auto reader = reader_of(file);
  const TimeBase base = reader->metadata().time_base;
  const stgs_contents contents = contents_of(scene);
  CHECK(contents.form == STGS_FORM_FINISHED);
  int tiers = 0;
  for (const SegmentInfo& segment : reader->segments()) tiers = std::max(tiers, segment.tier + 1);
  CHECK(contents.tiers == tiers);
  CHECK(contents.head_bytes == reader->head_bytes());
  CHECK(contents.missing_bytes == 0);
  CHECK(contents.chunk_seconds == base.seconds(reader->chunk_ticks()));
  CHECK(contents.is_window == 1);
  CHECK(contents.capture_id == 1);
  CHECK(contents.training_id == 2);
  CHECK(contents.damaged_segments == 0);
  CHECK(contents.window_first_frame == 60);
  CHECK(contents.capture_frames == 120);
  REQUIRE(contents.parts == 3);
  for (std::uint32_t i = 0; i < contents.parts; ++i) {
    auto part = sized<stgs_part>();
    REQUIRE(stgs_scene_get_part(scene.get(), i, &part) == STGS_OK);
    CHECK(part.begin_seconds == base.seconds(10 * i));
    CHECK(part.shown_end_seconds == base.seconds(10 * i + 10));
    CHECK(part.primitives == reader->parts()[i].primitives);
  }
  REQUIRE(contents.segments == reader->segments().size());
  for (std::uint32_t i = 0; i < contents.segments; ++i) {
    auto segment = sized<stgs_segment>();
    REQUIRE(stgs_scene_get_segment(scene.get(), i, &segment) == STGS_OK);
    const SegmentInfo& expected = reader->segments()[i];
    CHECK(segment.level == expected.level);
    CHECK(segment.tier == expected.tier);
    CHECK(segment.begin_seconds == base.seconds(expected.begin_ticks));
    CHECK(segment.offset == expected.offset);
    CHECK(segment.bytes == expected.bytes);
    CHECK(segment.sh_bytes == expected.sh_bytes);
    CHECK(segment.primitives == expected.primitives);
    CHECK(segment.part == expected.part);
    CHECK(segment.available == 1);
  }
  const auto streams = reader->streams();
  REQUIRE(contents.streams == streams.size());
  for (std::uint32_t i = 0; i < contents.streams; ++i) {
    auto stream = sized<stgs_stream>();
    REQUIRE(stgs_scene_get_stream(scene.get(), i, &stream) == STGS_OK);
    CHECK(stream.name == streams[i].name);
    CHECK(stream.bytes == streams[i].bytes);
    CHECK(stream.raw_bytes == streams[i].raw_bytes);
  }
  auto info = sized<stgs_scene_info>();
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  CHECK(info.audio_begin_seconds == -0.5);
  CHECK(info.near_plane == reader->metadata().near_plane);
}

TEST_CASE("the demands on a decoder are those of the decoder model", "[sdk]") {
  const Bytes file = file_with_parts();
  const ScenePtr scene = open_scene(file);
  auto needs = sized<stgs_decoder_needs>();
  REQUIRE(stgs_scene_get_decoder_needs(scene.get(), &needs) == STGS_OK);
  const DecoderNeeds expected = decoder_needs(*reader_of(file));
  CHECK(needs.level == expected.level);
  CHECK(needs.primitives == expected.primitives);
  CHECK(needs.segments == expected.segments);
  CHECK(needs.bytes == expected.bytes);
  CHECK(needs.decoded_bytes == expected.decoded_bytes);
  CHECK(needs.ranges == expected.ranges);
  CHECK(needs.index_bytes == expected.index_bytes);
  CHECK(needs.startup_bytes == expected.startup_bytes);
  CHECK(needs.bits_per_second == expected.bits_per_second);
  CHECK(needs.primitives_per_second == expected.primitives_per_second);
}

TEST_CASE("a truncated file and a lost fragment are described", "[sdk]") {
  Bytes cut = file_with_parts();
  const auto last = reader_of(cut)->segments().back();
  cut.resize(last.offset + 1);
  const ScenePtr truncated = open_scene(cut);
  const stgs_contents contents = contents_of(truncated);
  CHECK(contents.missing_bytes > 0);
  auto segment = sized<stgs_segment>();
  REQUIRE(stgs_scene_get_segment(truncated.get(), contents.segments - 1, &segment) == STGS_OK);
  CHECK(segment.available == 0);

  const Bytes file = file_with_lost_fragment();
  const ScenePtr recording = open_scene(file);
  const auto expected = reader_of(file)->lost_fragments();
  REQUIRE(contents_of(recording).lost_fragments == 1);
  auto lost = sized<stgs_lost_fragment>();
  REQUIRE(stgs_scene_get_lost_fragment(recording.get(), 0, &lost) == STGS_OK);
  CHECK(lost.offset == expected[0].offset);
  CHECK(lost.bytes == expected[0].bytes);
}

TEST_CASE("indices and states of the contents are checked", "[sdk]") {
  const Bytes file = file_with_parts();
  const ScenePtr scene = open_scene(file), closed = make_scene();
  auto part = sized<stgs_part>();
  CHECK(stgs_scene_get_part(scene.get(), 3, &part) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(error_of(scene.get()).message) ==
        "index: out of range (stgs_contents.parts is 3, got 3)");
  auto lost = sized<stgs_lost_fragment>();
  CHECK(stgs_scene_get_lost_fragment(scene.get(), 0, &lost) == STGS_ERROR_ARGUMENT);
  auto contents = sized<stgs_contents>();
  CHECK(stgs_scene_get_contents(closed.get(), &contents) == STGS_ERROR_STATE);
  auto statistics = sized<stgs_scene_statistics>();
  CHECK(stgs_scene_get_statistics(closed.get(), &statistics) == STGS_ERROR_STATE);
  CHECK(stgs_scene_get_segment(nullptr, 0, nullptr) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("statistics are those of the scene, and damage is logged", "[sdk]") {
  const Bytes file = file_with_parts();
  const auto read = read_scene(memory_source(file, "memory"));
  REQUIRE(read.ok());
  const SceneStatistics expected = scene_statistics(*read);
  std::vector<std::string> lines;
  stgs_scene_settings settings = scene_settings();
  settings.name = "clip";
  settings.log_user = &lines;
  settings.log = [](void* user, stgs_log_level, const char* message) {
    static_cast<std::vector<std::string>*>(user)->emplace_back(message);
  };
  ScenePtr scene = make_scene(&settings);
  REQUIRE(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
  auto statistics = sized<stgs_scene_statistics>();
  REQUIRE(stgs_scene_get_statistics(scene.get(), &statistics) == STGS_OK);
  CHECK(lines.empty());
  CHECK(statistics.primitives == expected.primitives);
  CHECK(statistics.never_visible == expected.never_visible);
  CHECK(statistics.median_lifespan == expected.median_lifespan);
  CHECK(statistics.median_speed == expected.median_speed);
  CHECK(statistics.static_share == expected.static_share());
  REQUIRE(statistics.lifespan_bins == expected.lifespans.size());
  for (std::uint32_t i = 0; i < statistics.lifespan_bins; ++i) {
    CHECK(statistics.lifespans[i].from == expected.lifespans[i].from);
    CHECK(statistics.lifespans[i].primitives == expected.lifespans[i].count);
  }
  REQUIRE(statistics.speed_bins == expected.speeds.size());

  Bytes damaged = file;
  const SegmentInfo first = reader_of(file)->segments().front();
  damaged[first.offset + first.bytes - 1] ^= 0xFF;
  scene = make_scene(&settings);
  REQUIRE(stgs_scene_open_memory(scene.get(), damaged.data(), damaged.size()) == STGS_OK);
  REQUIRE(stgs_scene_get_statistics(scene.get(), &statistics) == STGS_OK);
  CHECK(statistics.primitives == expected.primitives - first.primitives);
  REQUIRE(lines.size() == 1);
  CHECK(lines[0].find("clip: ") == 0);
}

TEST_CASE("rendering counts its steps if asked to, and the damage that it meets", "[sdk]") {
  Bytes file = file_with_parts();
  const auto reader = reader_of(file);
  const SegmentInfo& first = reader->segments().front();
  file[first.offset + first.bytes - 1] ^= 0xFF;
  const ScenePtr scene = open_scene(file);
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  CHECK(settings.measure == 0);
  settings.backend = STGS_BACKEND_CPU;
  settings.measure = 1;
  stgs_renderer* made = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &made) == STGS_OK);
  const RendererPtr renderer(made);
  auto statistics = sized<stgs_render_statistics>();
  CHECK(stgs_renderer_get_statistics(renderer.get(), &statistics) == STGS_ERROR_STATE);
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  view.width = 64;
  view.height = 36;
  REQUIRE(stgs_scene_frame_view(scene.get(), &view) == STGS_OK);
  const double seconds = reader->metadata().time_base.seconds(first.begin_ticks);
  render_rgba8(renderer.get(), scene.get(), seconds, view);
  check_output_struct<stgs_render_statistics>(
      "stgs_render_statistics", [&](stgs_render_statistics* out) {
        return stgs_renderer_get_statistics(renderer.get(), out);
      });
  REQUIRE(stgs_renderer_get_statistics(renderer.get(), &statistics) == STGS_OK);
  CHECK(statistics.splats > 0);
  CHECK(statistics.active_primitives >= statistics.splats);
  CHECK(statistics.blend_ms > 0);

  REQUIRE(contents_of(scene).damaged_segments == 1);
  check_output_struct<stgs_damaged_segment>("stgs_damaged_segment", [&](stgs_damaged_segment* out) {
    return stgs_scene_get_damaged_segment(scene.get(), 0, out);
  });
  auto damaged = sized<stgs_damaged_segment>();
  REQUIRE(stgs_scene_get_damaged_segment(scene.get(), 0, &damaged) == STGS_OK);
  CHECK(damaged.segment == 0);
  CHECK(damaged.sh_only == 0);
  CHECK(std::string(damaged.message).find("checksum") != std::string::npos);

  const RendererPtr silent = cpu_renderer();
  render_rgba8(silent.get(), scene.get(), seconds, view);
  CHECK(stgs_renderer_get_statistics(silent.get(), &statistics) == STGS_ERROR_STATE);
}

TEST_CASE("names and profiles of files are returned, and foreign content is named", "[sdk]") {
  stgs_scene_settings settings = scene_settings();
  std::string name = "camera 3";
  settings.name = name.c_str();
  ScenePtr scene = make_scene(&settings);
  name = "changed";  // the library has copied it
  const std::string json = "{\"not\": \"a scene, but long enough for a header of a scene file\"}";
  CHECK(stgs_scene_open_memory(scene.get(), json.data(), json.size()) == STGS_ERROR_INVALID_FILE);
  CHECK(std::string(error_of(scene.get()).message) ==
        "camera 3: not an .stgs file; this is a JSON file (byte 0, issue 102)");
  const Bytes file = file_with_parts();
  REQUIRE(stgs_scene_open_memory_copy(scene.get(), file.data(), file.size()) == STGS_OK);
  const char* text = nullptr;
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_NAME, &text) == STGS_OK);
  CHECK(std::string(text) == "camera 3");
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_PROFILE, &text) == STGS_OK);
  CHECK(std::string(text) == "quantised");
  stgs_scene_cancel(scene.get());  // only affects URLs
  stgs_scene_cancel(nullptr);
  auto statistics = sized<stgs_scene_statistics>();
  CHECK(stgs_scene_get_statistics(scene.get(), &statistics) == STGS_OK);
}

}  // namespace stgs::testing
