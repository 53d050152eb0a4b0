// SPDX-License-Identifier: Apache-2.0
// No memory at any one moment of recording and packing: every call says so or succeeds, and what
// has said so has changed nothing and can be tried again.
#include "../fuzz/heap.h"
#include "sdk_encoder_fixture.h"

namespace stgs::testing {
namespace {

constexpr std::uint32_t kFrames = 15;

bool is_told(stgs_result result) {
  return result == STGS_OK || result == STGS_ERROR_OUT_OF_MEMORY;
}

// The nth request within `call` finds no memory, in one thread, so that it is the same each time;
// whether there was one.
template <typename Call>
bool has_failed_at(int n, const Call& call) {
  fuzz::fail_requests(n, n);
  call();
  const bool failed = fuzz::have_failed();
  fuzz::fail_requests(0, 0);
  return failed;
}

stgs_record_settings settings_of_one_thread() {
  stgs_record_settings settings;
  REQUIRE(stgs_record_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.sync = 0;
  settings.threads = 1;
  return settings;
}

// What a recording of two stretches is.
Bytes recorded(const std::string& path, const stgs_fragment& stretch) {
  const stgs_record_settings settings = settings_of_one_thread();
  const RecorderPtr recorder = make_recorder();
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &stretch) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &stretch) == STGS_OK);
  REQUIRE(stgs_recorder_close(recorder.get()) == STGS_OK);
  return bytes_of(path);
}

}  // namespace

TEST_CASE("a scene is recorded with memory that ends at any moment", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const Primitives cloud(40);
  const stgs_fragment stretch = cloud.stretch(kFrames);
  const Bytes whole = recorded(folder / "whole.stgs", stretch);
  const stgs_record_settings settings = settings_of_one_thread();
  int failures = 0;
  // Tries what has found no memory once more.
  const auto at_any = [&](int n, const auto& call) {
    stgs_result result = STGS_OK;
    const bool failed = has_failed_at(n, [&] { result = call(); });
    if (result != STGS_OK) {
      ++failures;
      INFO("request " << n << ": " << result);
      REQUIRE(is_told(result));
      REQUIRE(call() == STGS_OK);
    }
    return failed;
  };
  bool failed = true;
  for (int n = 1; failed; n += n < 100 ? 1 : 23) {
    fs::remove(path);
    RecorderPtr recorder = make_recorder();
    failed =
        at_any(n, [&] { return stgs_recorder_begin(recorder.get(), path.c_str(), &settings); });
    const auto append = [&] { return stgs_recorder_append(recorder.get(), &stretch); };
    failed |= at_any(n, append);
    recorder = make_recorder();
    failed |=
        at_any(n, [&] { return stgs_recorder_resume(recorder.get(), path.c_str(), &settings); });
    failed |= at_any(n, append);
    failed |= at_any(n, [&] { return stgs_recorder_close(recorder.get()); });
    INFO("request " << n);
    REQUIRE((bytes_of(path) == whole));
  }
  CHECK(failures > 200);
}

TEST_CASE("a scene is packed with memory that ends at any moment", "[sdk]") {
  const TemporaryFolder folder;
  const std::string scene = folder / "scene.stgs", output = folder / "packed.stgs";
  const Primitives cloud(40);
  recorded(scene, cloud.stretch(kFrames));
  const char* const scenes[] = {scene.c_str()};
  const Watched watched(1);
  REQUIRE(stgs_encoder_pack(watched.get(), scenes, 1, output.c_str(), nullptr, nullptr) == STGS_OK);
  const Bytes whole = bytes_of(output);
  bool failed = true;
  int failures = 0;
  for (int n = 1; failed; n += n < 60 ? 1 : 37) {
    fs::remove(output);
    stgs_result result = STGS_OK;
    failed = has_failed_at(n, [&] {
      result = stgs_encoder_pack(watched.get(), scenes, 1, output.c_str(), nullptr, nullptr);
    });
    INFO("request " << n << ": " << result << " " << watched.error().message);
    REQUIRE(is_told(result));
    if (result != STGS_OK) {
      ++failures;
      REQUIRE_FALSE(fs::exists(output));
      REQUIRE(stgs_encoder_pack(watched.get(), scenes, 1, output.c_str(), nullptr, nullptr) ==
              STGS_OK);
    }
    REQUIRE((bytes_of(output) == whole));
  }
  CHECK(failures > 50);
}

}  // namespace stgs::testing
