// SPDX-License-Identifier: Apache-2.0
// Errors of recordings through the C API: rejected fragments and full disks leave the file
// unchanged.
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <functional>

#include "sdk_recorder_fixture.h"

namespace stgs::testing {
namespace {

// Makes a call while no file of this process can grow beyond `bytes`.
stgs_result with_file_size_limit(std::uint64_t bytes, const std::function<stgs_result()>& call) {
  rlimit before{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit limited{bytes, before.rlim_max};
  REQUIRE(setrlimit(RLIMIT_FSIZE, &limited) == 0);
  const stgs_result result = call();
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  return result;
}

}  // namespace

TEST_CASE("an invalid fragment is rejected with the name of its field and changes nothing",
          "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin_recording(path);
  const Primitives primitives(3);
  const stgs_fragment good = primitives.fragment(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  const Bytes before = bytes_of(path);
  const auto check_rejected = [&](const std::function<void(stgs_fragment&, Primitives&)>& change,
                                  const char* message, stgs_result result = STGS_ERROR_ARGUMENT) {
    Primitives changed(3);
    stgs_fragment fragment = changed.fragment(15);
    change(fragment, changed);
    INFO(message);
    CHECK(stgs_recorder_append(recorder.get(), &fragment) == result);
    INFO(message_of(recorder));
    CHECK(message_of(recorder).find(message) != std::string::npos);
    CHECK((bytes_of(path) == before));
  };
  check_rejected([](auto& f, auto&) { f.frames = 0; }, "frames is 0");
  check_rejected([](auto& f, auto&) { f.frames = UINT32_MAX; }, "exceed the limit of the format");
  check_rejected([](auto& f, auto&) { f.visible_frames = UINT32_MAX - 3; },
                 "exceed the limit of the format");
  check_rejected([](auto& f, auto&) { f.count = 1ull << 40; }, "count is 1099511627776");
  check_rejected([](auto& f, auto&) { f.position = nullptr; }, "position is NULL");
  check_rejected([](auto& f, auto&) { f.sh = nullptr; }, "sh is NULL");
  check_rejected([](auto& f, auto&) { f.sigma = nullptr; }, "only some of time, sigma and radius");
  check_rejected([](auto&, auto& p) { p.position[4] = NAN; }, "position[1] of primitive 1 is nan");
  check_rejected([](auto&, auto& p) { p.velocity[0] = INFINITY; },
                 "velocity[0] of primitive 0 is inf");
  check_rejected([](auto&, auto& p) { p.scale[8] = 0; }, "scale of primitive 2 is 0");
  check_rejected([](auto&, auto& p) { p.scale[7] = INFINITY; }, "scale[1] of primitive 2 is inf");
  check_rejected([](auto&, auto& p) { p.sh[5] = NAN; }, "sh[2] of primitive 1 is nan");
  check_rejected([](auto&, auto& p) { p.time[2] = NAN; }, "time of primitive 2 is nan");
  check_rejected([](auto&, auto& p) { std::fill_n(p.rotation.begin(), 4, 0.0f); },
                 "rotation of primitive 0");
  check_rejected([](auto&, auto& p) { p.opacity[1] = 1.5f; }, "opacity of primitive 1 is 1.5");
  check_rejected([](auto&, auto& p) { p.opacity[1] = NAN; }, "opacity of primitive 1 is nan");
  check_rejected([](auto&, auto& p) { p.sigma[0] = 0; },
                 "sigma of primitive 0 (expected > 0, got 0)");
  check_rejected([](auto&, auto& p) { p.radius[2] = -1; }, "radius of primitive 2");
  check_rejected([](auto&, auto& p) { p.importance[0] = -1; }, "importance of primitive 0");
  check_rejected([](auto&, auto& p) { p.position[0] = 1e38f; }, "exceeds the quantised range",
                 STGS_ERROR_UNSUPPORTED);
  CHECK(stgs_recorder_append(recorder.get(), nullptr) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  CHECK(status_of(recorder).frames == 30);
}

TEST_CASE("invalid record settings are rejected with the name of the field", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = make_recorder();
  const auto check_rejected = [&](const std::function<void(stgs_record_settings&)>& change,
                                  const char* message) {
    stgs_record_settings settings = record_settings();
    change(settings);
    INFO(message);
    CHECK(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_ERROR_ARGUMENT);
    INFO(message_of(recorder));
    CHECK(message_of(recorder).find(message) != std::string::npos);
    CHECK_FALSE(fs::exists(path));
  };
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  view.fx = 0;
  check_rejected([](auto& s) { s.time_base_numerator = 0; }, "time_base_numerator is 0");
  check_rejected([](auto& s) { s.time_base_denominator = 0; }, "time_base_denominator is 0");
  check_rejected([](auto& s) { s.sh_degree = 4; }, "sh_degree is 4");
  check_rejected([](auto& s) { s.profile = 7; }, "profile is 7");
  check_rejected([](auto& s) { s.profile = STGS_PROFILE_NEAR_LOSSLESS; }, "profile is 2");
  check_rejected([](auto& s) { s.tiers = -1; }, "tiers is -1");
  check_rejected([](auto& s) { s.quality = 101; }, "quality is 101");
  check_rejected([](auto& s) { s.max_error = -1; }, "max_error is -1");
  check_rejected([](auto& s) { s.chunk_seconds = 1e-9; }, "chunk_seconds is 1e-09");
  check_rejected([](auto& s) { s.sync = 2; }, "sync is 2");
  check_rejected([](auto& s) { s.threads = 5000; }, "threads is 5000");
  check_rejected([](auto& s) { s.metres_per_unit = -1; }, "metres_per_unit is -1");
  check_rejected([](auto& s) { s.up[2] = NAN; }, "up is nan");
  check_rejected([](auto& s) { s.floor[2] = 1e30f; }, "floor is 1.0");
  check_rejected([](auto& s) { s.audio_begin = 1e9; }, "audio_begin is 1000000000");
  check_rejected([](auto& s) { s.title = "\xff"; }, "UTF-8");
  const std::string long_text(4097, 'a');
  check_rejected([&](auto& s) { s.title = long_text.c_str(); }, "title has 4097 bytes");
  check_rejected([&](auto& s) { s.audio = long_text.c_str(); }, "audio has 4097 bytes");
  check_rejected([&](auto& s) { s.start_view = &view; }, "start camera");
  view.fx = 1;
  view.near_plane = 0;
  check_rejected([&](auto& s) { s.start_view = &view; }, "near_plane is 0");
  CHECK(stgs_recorder_begin(recorder.get(), nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_recorder_begin(recorder.get(), (folder / "no/live.stgs").c_str(), nullptr) ==
        STGS_ERROR_IO);
  CHECK(stgs_recorder_resume(recorder.get(), path.c_str(), nullptr) == STGS_ERROR_IO);

  stgs_fragment empty;
  REQUIRE(stgs_fragment_defaults(&empty, sizeof empty) == STGS_OK);
  auto status = empty_output<stgs_recorder_status>();
  CHECK(stgs_recorder_append(recorder.get(), &empty) == STGS_ERROR_STATE);
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

TEST_CASE("a full disk ends a recording after its last complete fragment", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = begin_recording(path);
  const Primitives few(3), many(3000);
  const stgs_fragment good = few.minimal_fragment(15), large = many.minimal_fragment(15);
  REQUIRE(stgs_recorder_append(recorder.get(), &good) == STGS_OK);
  const Bytes before = bytes_of(path);
  const stgs_result result = with_file_size_limit(
      before.size() + 1000, [&] { return stgs_recorder_append(recorder.get(), &large); });
  CHECK(result == STGS_ERROR_IO);
  CHECK((bytes_of(path) == before));
  CHECK(status_of(recorder).frames == 15);
  CHECK(status_of(recorder).primitives == 3);
  CHECK(status_of(recorder).bytes == before.size());
  CHECK(stgs_recorder_append(recorder.get(), &good) == STGS_ERROR_STATE);
  CHECK(stgs_recorder_close(recorder.get()) == STGS_ERROR_STATE);
  CHECK(info_of(open_path(path)).issues == 0);
  // Another recorder can resume while the failed one still exists.
  const RecorderPtr next = make_recorder();
  REQUIRE(stgs_recorder_resume(next.get(), path.c_str(), nullptr) == STGS_OK);
  REQUIRE(stgs_recorder_append(next.get(), &large) == STGS_OK);
  CHECK(info_of(open_path(path)).frames == 30);
}

TEST_CASE("a recorder can begin again after a failed begin", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const RecorderPtr recorder = make_recorder();
  CHECK(with_file_size_limit(100, [&] {
          return stgs_recorder_begin(recorder.get(), path.c_str(), nullptr);
        }) == STGS_ERROR_IO);
  CHECK_FALSE(fs::exists(path));
  CHECK(stgs_recorder_begin(recorder.get(), path.c_str(), nullptr) == STGS_OK);
}

}  // namespace stgs::testing
