// SPDX-License-Identifier: Apache-2.0
// Recordings through the C API: primitives and metadata survive the round trip while the file
// grows.
#include <array>
#include <cmath>
#include <cstddef>

#include "sdk_recorder_fixture.h"
#include "stgs/stgs_encoder.hpp"

namespace stgs::testing {
namespace {

// Row-major; the quaternion need not be normalised.
std::array<double, 9> covariance(const float* q, const float* scale) {
  const double n = std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] + double{q[2]} * q[2] +
                             double{q[3]} * q[3]);
  const double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
  const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                       2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  std::array<double, 9> out{};
  for (std::size_t i = 0; i < 9; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      out[i] += r[i / 3 * 3 + k] * r[i % 3 * 3 + k] * scale[k] * scale[k];
    }
  }
  return out;
}

std::uint64_t visible_at(const ScenePtr& scene, double seconds) {
  std::uint64_t count = 0;
  REQUIRE(stgs_scene_get_primitives(scene.get(), seconds, nullptr, &count) == STGS_OK);
  return count;
}

}  // namespace

TEST_CASE("a recording reproduces the appended primitives while it grows", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin_recording(path);
  const Primitives first(3), second(2, 10);
  const stgs_fragment a = first.fragment(15), b = second.fragment(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &a) == STGS_OK);
  CHECK(info_of(open_path(path)).complete_seconds == Approx(0.5));
  REQUIRE(stgs_recorder_append(recorder.get(), &b) == STGS_OK);
  const stgs_recorder_status status = status_of(recorder);
  CHECK(status.frames == 30);
  CHECK(status.bytes == fs::file_size(path));
  CHECK(status.time_base_denominator == 30);

  const ScenePtr scene = open_path(path);  // the recorder still has the file open
  const stgs_scene_info info = info_of(scene);
  CHECK(info.primitives == 5);
  CHECK(info.duration_seconds == Approx(1));
  CHECK(info.issues == 0);
  // Fully visible from 0.1 s to 0.3 s of each fragment, and fading shortly before and after.
  CHECK(visible_at(scene, 0.02) == 0);
  CHECK(visible_at(scene, 0.2) == 3);
  CHECK(visible_at(scene, 0.45) == 0);
  CHECK(visible_at(scene, 0.7) == 2);
  float position[9], velocity[9], scale[9], rotation[12], opacity[3], sh[9];
  stgs_primitives arrays;
  REQUIRE(stgs_primitives_defaults(&arrays, sizeof arrays) == STGS_OK);
  arrays.capacity = 3;
  arrays.position = position;
  arrays.velocity = velocity;
  arrays.scale = scale;
  arrays.rotation = rotation;
  arrays.opacity = opacity;
  arrays.sh = sh;
  std::uint64_t count = 0;
  REQUIRE(stgs_scene_get_primitives(scene.get(), 0.75, &arrays, &count) == STGS_OK);
  REQUIRE(count == 2);
  const bool in_order = position[0] < position[3];
  for (std::size_t i = 0; i < 2; ++i) {
    INFO(i);
    const std::size_t source = (i == 0) == in_order ? 0 : 1;
    for (std::size_t c = 0; c < 3; ++c) {
      const float expected = second.position[3 * source + c] + 0.05f * second.velocity[c];
      CHECK(position[3 * i + c] == Approx(expected).margin(4e-3));
      CHECK(velocity[3 * i + c] == Approx(second.velocity[c]).margin(0.06));
      CHECK(sh[3 * i + c] == Approx(second.sh[c]).margin(0.02));
    }
    // Compares covariances, because several pairs of rotation and scale give one shape.
    const auto shape = covariance(rotation + 4 * i, scale + 3 * i);
    const auto expected_shape = covariance(second.rotation.data(), second.scale.data());
    for (std::size_t c = 0; c < 9; ++c) {
      CHECK(shape[c] == Approx(expected_shape[c]).margin(0.005));
    }
    CHECK(opacity[i] == Approx(0.5).margin(0.02));
  }
}

TEST_CASE("primitives without optional arrays are static and visible for their entire fragment",
          "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin_recording(path);
  const Primitives primitives(4);
  stgs_fragment lasting = primitives.minimal_fragment(6);
  lasting.visible_frames = 40;
  REQUIRE(stgs_recorder_append(recorder.get(), &lasting) == STGS_OK);
  const stgs_fragment brief = primitives.minimal_fragment(12);
  REQUIRE(stgs_recorder_append(recorder.get(), &brief) == STGS_OK);
  stgs_fragment empty;
  REQUIRE(stgs_fragment_defaults(&empty, sizeof empty) == STGS_OK);
  for (int i = 0; i < 30; ++i) {
    REQUIRE(stgs_recorder_append(recorder.get(), &empty) == STGS_OK);
  }
  REQUIRE(stgs_recorder_close(recorder.get()) == STGS_OK);
  CHECK(status_of(recorder).bytes == fs::file_size(path));
  const ScenePtr scene = open_path(path);
  CHECK(info_of(scene).frames == 48);
  CHECK(visible_at(scene, 0) == 4);
  CHECK(visible_at(scene, 5.9 / 30) == 4);
  CHECK(visible_at(scene, 6.1 / 30) == 8);
  CHECK(visible_at(scene, 17.9 / 30) == 8);
  CHECK(visible_at(scene, 18.1 / 30) == 4);
  CHECK(visible_at(scene, 39.9 / 30) == 4);
  CHECK(visible_at(scene, 40.1 / 30) == 0);
}

TEST_CASE("a recording stores the metadata of its settings", "[sdk]") {
  const TemporaryFolder folder;
  stgs_record_settings settings = record_settings();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  view.translation[2] = 3;
  view.near_plane = 0.25f;
  view.background[1] = 0.5f;
  settings.time_base_numerator = 1001;
  settings.time_base_denominator = 60000;
  settings.sh_degree = 2;
  settings.title = "a title";
  settings.metres_per_unit = 0.5;
  settings.up[1] = -4;
  settings.floor[1] = 1.5f;
  settings.start_view = &view;
  settings.audio = "audio.ogg";
  settings.threads = 2;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = make_recorder();
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  stgs_fragment empty;
  REQUIRE(stgs_fragment_defaults(&empty, sizeof empty) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &empty) == STGS_OK);

  const ScenePtr scene = open_path(path);
  const stgs_scene_info info = info_of(scene);
  CHECK(info.time_base_numerator == 1001);
  CHECK(info.time_base_denominator == 60000);
  CHECK(info.sh_degree == 2);
  CHECK(info.metres_per_unit == 0.5f);
  CHECK(info.up[1] == -1);
  CHECK(info.floor[1] == 1.5f);
  const stgs_view start = start_view(scene.get());
  CHECK(std::memcmp(&start, &view, sizeof view) == 0);
  const char* text = nullptr;
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_TITLE, &text) == STGS_OK);
  CHECK(std::string(text) == "a title");
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_AUDIO, &text) == STGS_OK);
  CHECK(std::string(text) == "audio.ogg");
}

TEST_CASE("an abandoned recording is complete up to its last fragment and can be resumed",
          "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const Primitives primitives(3);
  const stgs_fragment fragment = primitives.minimal_fragment(15);
  RecorderPtr recorder = begin_recording(path);
  REQUIRE(stgs_recorder_append(recorder.get(), &fragment) == STGS_OK);
  const RecorderPtr other = make_recorder();
  CHECK(stgs_recorder_resume(other.get(), path.c_str(), nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(message_of(other).find(path) != std::string::npos);
  recorder.reset();
  CHECK(info_of(open_path(path)).frames == 15);
  std::ofstream(path, std::ios::binary | std::ios::app) << "half a fragment";

  REQUIRE(stgs_recorder_resume(other.get(), path.c_str(), nullptr) == STGS_OK);
  CHECK(status_of(other).frames == 15);
  CHECK(status_of(other).sh_degree == 0);
  REQUIRE(stgs_recorder_append(other.get(), &fragment) == STGS_OK);
  REQUIRE(stgs_recorder_close(other.get()) == STGS_OK);
  CHECK(info_of(open_path(path)).frames == 30);
  CHECK(info_of(open_path(path)).issues == 0);
  CHECK(stgs_recorder_append(other.get(), &fragment) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_close(other.get()) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_resume(make_recorder().get(), path.c_str(), nullptr) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("primitives without a lifespan are visible throughout the longest fragments", "[sdk]") {
  const TemporaryFolder folder;
  const Primitives primitives(3);
  const std::uint32_t frames = GENERATE(1u, 2'000'000'000u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu);
  const bool outlives = GENERATE(false, true);  // visible longer than its fragment
  CAPTURE(frames, outlives);
  const std::string path = folder / "live.stgs";
  RecorderPtr recorder = make_recorder();
  stgs_record_settings settings = record_settings();
  settings.time_base_denominator = 1'000'000;
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  stgs_fragment fragment = primitives.minimal_fragment(outlives ? 1 : frames);
  fragment.visible_frames = outlives ? frames : 0;
  REQUIRE(stgs_recorder_append(recorder.get(), &fragment) == STGS_OK);
  if (outlives && frames > 1) {
    stgs_fragment rest;
    REQUIRE(stgs_fragment_defaults(&rest, sizeof rest) == STGS_OK);
    rest.frames = frames - 1;
    REQUIRE(stgs_recorder_append(recorder.get(), &rest) == STGS_OK);
  }
  CHECK(status_of(recorder).primitives == 3);
  const ScenePtr scene = open_path(path);
  for (const std::uint32_t frame : {0u, frames / 2, frames - 1}) {
    CAPTURE(frame);
    CHECK(visible_at(scene, frame * 1e-6) == 3);
  }
}

TEST_CASE("a recorder counts primitives that are never visible", "[sdk]") {
  const TemporaryFolder folder;
  const RecorderPtr recorder = begin_recording(folder / "live.stgs");
  Primitives primitives(3);
  primitives.time = {0.2f, 3600.2f, 3600.2f};  // two an hour after the fragment
  const stgs_fragment fragment = primitives.fragment(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &fragment) == STGS_OK);
  CHECK(status_of(recorder).primitives == 1);
  CHECK(status_of(recorder).dropped == 2);
}

TEST_CASE("the recorder accepts structs of older and newer headers", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto record = [&](const stgs_record_settings* settings) {
    fs::remove(path);
    return stgs_recorder_begin(make_recorder().get(), path.c_str(), settings);
  };
  check_input_struct("stgs_record_settings", record_settings(), 16, record);
  fs::remove(path);
  const RecorderPtr recorder = begin_recording(path);
  stgs_fragment empty;
  REQUIRE(stgs_fragment_defaults(&empty, sizeof empty) == STGS_OK);
  check_input_struct("stgs_fragment", empty, 16, [&](const stgs_fragment* fragment) {
    return stgs_recorder_append(recorder.get(), fragment);
  });
  check_output_struct<stgs_recorder_status>(
      "stgs_recorder_status", [&](stgs_recorder_status* status) {
        return stgs_recorder_get_status(recorder.get(), status);
      });
}

TEST_CASE("the C++ recorder throws on errors of the C API", "[sdk]") {
  const TemporaryFolder folder;
  Recorder recorder;
  recorder.begin(folder / "live.stgs");
  const Primitives primitives(3);
  recorder.append(primitives.minimal_fragment(15));
  CHECK(recorder.status().frames == 15);
  stgs_fragment wrong = empty_fragment();
  wrong.frames = 0;
  CHECK_THROWS_AS(recorder.append(wrong), Error);
  recorder.close();
  CHECK(info_of(open_path(folder / "live.stgs")).primitives == 3);
}

}  // namespace stgs::testing
