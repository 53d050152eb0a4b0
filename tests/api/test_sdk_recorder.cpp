// SPDX-License-Identifier: Apache-2.0
// Recordings by the C interface: what is appended is what is read, whenever, and what is refused
// changes nothing.
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <functional>

#include "sdk_encoder_fixture.h"
#include "stgs/stgs_encoder.hpp"

namespace stgs::testing {
namespace {

stgs_record_settings record_settings() {
  stgs_record_settings settings;
  REQUIRE(stgs_record_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.quality = 100;
  settings.sync = 0;
  return settings;
}
RecorderPtr begin(const std::string& path) {
  RecorderPtr recorder = make_recorder();
  const stgs_record_settings settings = record_settings();
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  return recorder;
}
std::string words_of(const RecorderPtr& recorder) {
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_recorder_error(recorder.get(), &error) == STGS_OK);
  return error.message;
}
stgs_recorder_status status_of(const RecorderPtr& recorder) {
  auto status = empty_report<stgs_recorder_status>();
  REQUIRE(stgs_recorder_get_status(recorder.get(), &status) == STGS_OK);
  return status;
}

// Row by row; the quaternion may have any length.
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

ScenePtr opened(const std::string& path) {
  ScenePtr scene = make_scene();
  REQUIRE(stgs_scene_open(scene.get(), path.c_str()) == STGS_OK);
  return scene;
}
stgs_scene_info info_of(const ScenePtr& scene) {
  auto info = empty_report<stgs_scene_info>();
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  return info;
}
std::uint64_t seen_at(const ScenePtr& scene, double seconds) {
  std::uint64_t count = 0;
  REQUIRE(stgs_scene_get_primitives(scene.get(), seconds, nullptr, &count) == STGS_OK);
  return count;
}

// Of a call while files of this process can have so many bytes.
stgs_result with_room(std::uint64_t bytes, const std::function<stgs_result()>& call) {
  rlimit was{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &was) == 0);
  const auto handled = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{bytes, was.rlim_max};
  REQUIRE(setrlimit(RLIMIT_FSIZE, &small) == 0);
  const stgs_result result = call();
  setrlimit(RLIMIT_FSIZE, &was);
  std::signal(SIGXFSZ, handled);
  return result;
}

}  // namespace

TEST_CASE("what is recorded is what the application had", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin(path);
  const Primitives first(3), second(2, 10);
  const stgs_fragment a = first.stretch(15), b = second.stretch(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &a) == STGS_OK);
  CHECK(info_of(opened(path)).complete_seconds == Approx(0.5));
  REQUIRE(stgs_recorder_append(recorder.get(), &b) == STGS_OK);
  const stgs_recorder_status status = status_of(recorder);
  CHECK(status.frames == 30);
  CHECK(status.bytes == fs::file_size(path));
  CHECK(status.time_base_denominator == 30);

  const ScenePtr scene = opened(path);  // while it is recorded
  const stgs_scene_info info = info_of(scene);
  CHECK(info.primitives == 5);
  CHECK(info.duration_seconds == Approx(1));
  CHECK(info.issues == 0);
  // In full from .1 to .3, and then for a little more, after each beginning.
  CHECK(seen_at(scene, 0.02) == 0);
  CHECK(seen_at(scene, 0.2) == 3);
  CHECK(seen_at(scene, 0.45) == 0);
  CHECK(seen_at(scene, 0.7) == 2);
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
  const bool ordered = position[0] < position[3];
  for (std::size_t i = 0; i < 2; ++i) {
    INFO(i);
    const std::size_t was = (i == 0) == ordered ? 0 : 1;
    for (std::size_t c = 0; c < 3; ++c) {
      const float moved = second.position[3 * was + c] + 0.05f * second.velocity[c];
      CHECK(position[3 * i + c] == Approx(moved).margin(2e-3));
      CHECK(velocity[3 * i + c] == Approx(second.velocity[c]).margin(0.02));
      CHECK(sh[3 * i + c] == Approx(second.sh[c]).margin(0.02));
    }
    // A shape has several pairs of rotation and scales.
    const auto shape = covariance(rotation + 4 * i, scale + 3 * i);
    const auto was_shape = covariance(second.rotation.data(), second.scale.data());
    for (std::size_t c = 0; c < 9; ++c) {
      CHECK(shape[c] == Approx(was_shape[c]).margin(0.005));
    }
    CHECK(opacity[i] == Approx(0.5).margin(0.02));
  }
}

TEST_CASE("what a stretch leaves out is that of splats that stay as they are", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin(path);
  const Primitives made(4);
  stgs_fragment room = made.plain(6);
  room.visible_frames = 40;
  REQUIRE(stgs_recorder_append(recorder.get(), &room) == STGS_OK);
  const stgs_fragment short_one = made.plain(12);
  REQUIRE(stgs_recorder_append(recorder.get(), &short_one) == STGS_OK);
  stgs_fragment nothing;
  REQUIRE(stgs_fragment_defaults(&nothing, sizeof nothing) == STGS_OK);
  for (int i = 0; i < 30; ++i) {
    REQUIRE(stgs_recorder_append(recorder.get(), &nothing) == STGS_OK);
  }
  REQUIRE(stgs_recorder_close(recorder.get()) == STGS_OK);
  CHECK(status_of(recorder).bytes == fs::file_size(path));
  const ScenePtr scene = opened(path);
  CHECK(info_of(scene).frames == 48);
  CHECK(seen_at(scene, 0) == 4);
  CHECK(seen_at(scene, 5.9 / 30) == 4);
  CHECK(seen_at(scene, 6.1 / 30) == 8);
  CHECK(seen_at(scene, 17.9 / 30) == 8);
  CHECK(seen_at(scene, 18.1 / 30) == 4);
  CHECK(seen_at(scene, 39.9 / 30) == 4);
  CHECK(seen_at(scene, 40.1 / 30) == 0);
}

TEST_CASE("a recording says what its scene is", "[sdk]") {
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
  stgs_fragment nothing;
  REQUIRE(stgs_fragment_defaults(&nothing, sizeof nothing) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &nothing) == STGS_OK);

  const ScenePtr scene = opened(path);
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

TEST_CASE("a recording that was left is whole up to its last stretch, and can be gone on with",
          "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const Primitives made(3);
  const stgs_fragment stretch = made.plain(15);
  RecorderPtr recorder = begin(path);
  REQUIRE(stgs_recorder_append(recorder.get(), &stretch) == STGS_OK);
  const RecorderPtr other = make_recorder();
  CHECK(stgs_recorder_resume(other.get(), path.c_str(), nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(words_of(other).find(path) != std::string::npos);
  recorder.reset();
  CHECK(info_of(opened(path)).frames == 15);
  std::ofstream(path, std::ios::binary | std::ios::app) << "half a stretch";

  REQUIRE(stgs_recorder_resume(other.get(), path.c_str(), nullptr) == STGS_OK);
  CHECK(status_of(other).frames == 15);
  CHECK(status_of(other).sh_degree == 0);
  REQUIRE(stgs_recorder_append(other.get(), &stretch) == STGS_OK);
  REQUIRE(stgs_recorder_close(other.get()) == STGS_OK);
  CHECK(info_of(opened(path)).frames == 30);
  CHECK(info_of(opened(path)).issues == 0);
  CHECK(stgs_recorder_append(other.get(), &stretch) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_close(other.get()) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_resume(make_recorder().get(), path.c_str(), nullptr) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("stretches that are none are named, and change nothing", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin(path);
  const Primitives made(3);
  const stgs_fragment good = made.stretch(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  const Bytes before = bytes_of(path);
  const auto refused = [&](const std::function<void(stgs_fragment&, Primitives&)>& change,
                           const char* words, stgs_result result = STGS_ERROR_ARGUMENT) {
    Primitives wrong(3);
    stgs_fragment stretch = wrong.stretch(15);
    change(stretch, wrong);
    INFO(words);
    CHECK(stgs_recorder_append(recorder.get(), &stretch) == result);
    INFO(words_of(recorder));
    CHECK(words_of(recorder).find(words) != std::string::npos);
    CHECK((bytes_of(path) == before));
  };
  refused([](auto& s, auto&) { s.frames = 0; }, "frames is 0");
  refused([](auto& s, auto&) { s.frames = UINT32_MAX; }, "exceed the limit of the format");
  refused([](auto& s, auto&) { s.visible_frames = UINT32_MAX - 3; },
          "exceed the limit of the format");
  refused([](auto& s, auto&) { s.count = 1ull << 40; }, "count is 1099511627776");
  refused([](auto& s, auto&) { s.position = nullptr; }, "position is NULL");
  refused([](auto& s, auto&) { s.sh = nullptr; }, "sh is NULL");
  refused([](auto& s, auto&) { s.sigma = nullptr; }, "only some of time, sigma and radius");
  refused([](auto&, auto& p) { p.position[4] = NAN; }, "position[1] of primitive 1 is nan");
  refused([](auto&, auto& p) { p.velocity[0] = INFINITY; }, "velocity[0] of primitive 0 is inf");
  refused([](auto&, auto& p) { p.scale[8] = 0; }, "scale of primitive 2 is 0");
  refused([](auto&, auto& p) { p.scale[7] = INFINITY; }, "scale[1] of primitive 2 is inf");
  refused([](auto&, auto& p) { p.sh[5] = NAN; }, "sh[2] of primitive 1 is nan");
  refused([](auto&, auto& p) { p.time[2] = NAN; }, "time of primitive 2 is nan");
  refused([](auto&, auto& p) { std::fill_n(p.rotation.begin(), 4, 0.0f); },
          "rotation of primitive 0");
  refused([](auto&, auto& p) { p.opacity[1] = 1.5f; }, "opacity of primitive 1 is 1.5");
  refused([](auto&, auto& p) { p.opacity[1] = NAN; }, "opacity of primitive 1 is nan");
  refused([](auto&, auto& p) { p.sigma[0] = 0; }, "sigma of primitive 0 (expected > 0, got 0)");
  refused([](auto&, auto& p) { p.radius[2] = -1; }, "radius of primitive 2");
  refused([](auto&, auto& p) { p.importance[0] = -1; }, "importance of primitive 0");
  refused([](auto&, auto& p) { p.position[0] = 1e38f; }, "exceeds the quantised range",
          STGS_ERROR_UNSUPPORTED);
  CHECK(stgs_recorder_append(recorder.get(), nullptr) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  CHECK(status_of(recorder).frames == 30);
}

TEST_CASE("settings of a recording that are none are named, and another try may follow", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = make_recorder();
  const auto refused = [&](const std::function<void(stgs_record_settings&)>& change,
                           const char* words) {
    stgs_record_settings settings = record_settings();
    change(settings);
    INFO(words);
    CHECK(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_ERROR_ARGUMENT);
    INFO(words_of(recorder));
    CHECK(words_of(recorder).find(words) != std::string::npos);
    CHECK_FALSE(fs::exists(path));
  };
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  view.fx = 0;
  refused([](auto& s) { s.time_base_numerator = 0; }, "time_base_numerator is 0");
  refused([](auto& s) { s.time_base_denominator = 0; }, "time_base_denominator is 0");
  refused([](auto& s) { s.sh_degree = 4; }, "sh_degree is 4");
  refused([](auto& s) { s.profile = 7; }, "profile is 7");
  refused([](auto& s) { s.tiers = -1; }, "tiers is -1");
  refused([](auto& s) { s.quality = 101; }, "quality is 101");
  refused([](auto& s) { s.max_error = -1; }, "max_error is -1");
  refused([](auto& s) { s.chunk_seconds = 1e-9; }, "chunk_seconds is 1e-09");
  refused([](auto& s) { s.sync = 2; }, "sync is 2");
  refused([](auto& s) { s.threads = 5000; }, "threads is 5000");
  refused([](auto& s) { s.metres_per_unit = -1; }, "metres_per_unit is -1");
  refused([](auto& s) { s.up[2] = NAN; }, "up is nan");
  refused([](auto& s) { s.floor[2] = 1e30f; }, "floor is 1.0");
  refused([](auto& s) { s.audio_begin = 1e9; }, "audio_begin is 1000000000");
  refused([](auto& s) { s.title = "\xff"; }, "UTF-8");
  const std::string long_text(4097, 'a');
  refused([&](auto& s) { s.title = long_text.c_str(); }, "title has 4097 bytes");
  refused([&](auto& s) { s.audio = long_text.c_str(); }, "audio has 4097 bytes");
  refused([&](auto& s) { s.start_view = &view; }, "start camera");
  view.fx = 1;
  view.near_plane = 0;
  refused([&](auto& s) { s.start_view = &view; }, "near_plane is 0");
  CHECK(stgs_recorder_begin(recorder.get(), nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_recorder_begin(recorder.get(), (folder / "no/live.stgs").c_str(), nullptr) ==
        STGS_ERROR_IO);
  CHECK(stgs_recorder_resume(recorder.get(), path.c_str(), nullptr) == STGS_ERROR_IO);

  stgs_fragment nothing;
  REQUIRE(stgs_fragment_defaults(&nothing, sizeof nothing) == STGS_OK);
  auto status = empty_report<stgs_recorder_status>();
  CHECK(stgs_recorder_append(recorder.get(), &nothing) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_close(recorder.get()) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_get_status(recorder.get(), &status) == STGS_ERROR_STATE);
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), nullptr) == STGS_OK);
  CHECK(stgs_recorder_begin(recorder.get(), (folder / "b.stgs").c_str(), nullptr) ==
        STGS_ERROR_STATE);
  CHECK(stgs_recorder_resume(recorder.get(), path.c_str(), nullptr) == STGS_ERROR_STATE);
  const Bytes before = bytes_of(path);
  CHECK(stgs_recorder_begin(make_recorder().get(), path.c_str(), nullptr) == STGS_ERROR_IO);
  CHECK((bytes_of(path) == before));
  CHECK(stgs_recorder_create(nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_recorder_close(nullptr) == STGS_ERROR_ARGUMENT);
  stgs_recorder_destroy(nullptr);
}

TEST_CASE("a full disk ends a recording at the stretch before", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin(path);
  const Primitives made(3), many(3000);
  const stgs_fragment good = made.plain(15), large = many.plain(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  const Bytes before = bytes_of(path);
  const stgs_result result =
      with_room(before.size() + 1000, [&] { return stgs_recorder_append(recorder.get(), &large); });
  CHECK(result == STGS_ERROR_IO);
  CHECK((bytes_of(path) == before));
  CHECK(status_of(recorder).frames == 15);
  CHECK(status_of(recorder).primitives == 3);
  CHECK(status_of(recorder).bytes == before.size());
  CHECK(stgs_recorder_append(recorder.get(), &good) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_close(recorder.get()) == STGS_ERROR_STATE);
  CHECK(info_of(opened(path)).issues == 0);
  // Beside the one that has ended.
  const RecorderPtr next = make_recorder();
  REQUIRE(stgs_recorder_resume(next.get(), path.c_str(), nullptr) == STGS_OK);
  REQUIRE(stgs_recorder_append(next.get(), &large) == STGS_OK);
  CHECK(info_of(opened(path)).frames == 30);
}

TEST_CASE("a recording that cannot be begun can be tried again", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = make_recorder();
  CHECK(with_room(100, [&] {
          return stgs_recorder_begin(recorder.get(), path.c_str(), nullptr);
        }) == STGS_ERROR_IO);
  CHECK_FALSE(fs::exists(path));
  CHECK(stgs_recorder_begin(recorder.get(), path.c_str(), nullptr) == STGS_OK);
}

TEST_CASE("what has no lifespan is seen throughout the longest stretches", "[sdk]") {
  const TemporaryFolder folder;
  const Primitives made(3);
  const std::uint32_t frames = GENERATE(1u, 2'000'000'000u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu);
  const bool stays = GENERATE(false, true);
  CAPTURE(frames, stays);
  const std::string path = folder / "live.stgs";
  RecorderPtr recorder = make_recorder();
  stgs_record_settings settings = record_settings();
  settings.time_base_denominator = 1'000'000;
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  stgs_fragment stretch = made.plain(stays ? 1 : frames);
  stretch.visible_frames = stays ? frames : 0;
  REQUIRE(stgs_recorder_append(recorder.get(), &stretch) == STGS_OK);
  if (stays && frames > 1) {
    stgs_fragment rest;
    REQUIRE(stgs_fragment_defaults(&rest, sizeof rest) == STGS_OK);
    rest.frames = frames - 1;
    REQUIRE(stgs_recorder_append(recorder.get(), &rest) == STGS_OK);
  }
  CHECK(status_of(recorder).primitives == 3);
  const ScenePtr scene = opened(path);
  for (const std::uint32_t frame : {0u, frames / 2, frames - 1}) {
    CAPTURE(frame);
    CHECK(seen_at(scene, frame * 1e-6) == 3);
  }
}

TEST_CASE("a recorder counts what is never seen, as of times of another clock", "[sdk]") {
  const TemporaryFolder folder;
  const RecorderPtr recorder = begin(folder / "live.stgs");
  Primitives made(3);
  made.time = {0.2f, 3600.2f, 3600.2f};
  const stgs_fragment stretch = made.stretch(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &stretch) == STGS_OK);
  CHECK(status_of(recorder).primitives == 1);
  CHECK(status_of(recorder).dropped == 2);
}

TEST_CASE("structs of a recorder are of any version of its header", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto record = [&](const stgs_record_settings* settings) {
    fs::remove(path);
    return stgs_recorder_begin(make_recorder().get(), path.c_str(), settings);
  };
  check_taken("stgs_record_settings", record_settings(), 16, record);
  fs::remove(path);
  const RecorderPtr recorder = begin(path);
  stgs_fragment nothing;
  REQUIRE(stgs_fragment_defaults(&nothing, sizeof nothing) == STGS_OK);
  check_taken("stgs_fragment", nothing, 16, [&](const stgs_fragment* stretch) {
    return stgs_recorder_append(recorder.get(), stretch);
  });
  check_given<stgs_recorder_status>("stgs_recorder_status", [&](stgs_recorder_status* status) {
    return stgs_recorder_get_status(recorder.get(), status);
  });
}

TEST_CASE("a recorder of C++ throws what the C interface says", "[sdk]") {
  const TemporaryFolder folder;
  Recorder recorder;
  recorder.begin(folder / "live.stgs");
  const Primitives made(3);
  recorder.append(made.plain(15));
  CHECK(recorder.status().frames == 15);
  stgs_fragment wrong = empty_fragment();
  wrong.frames = 0;
  CHECK_THROWS_AS(recorder.append(wrong), Error);
  recorder.close();
  CHECK(info_of(opened(folder / "live.stgs")).primitives == 3);
}

}  // namespace stgs::testing
