// SPDX-License-Identifier: Apache-2.0
// Failing allocations during recording, packing and live pushes. Every call succeeds or returns
// STGS_ERROR_OUT_OF_MEMORY; a failed call changes nothing and can be repeated.
#include "../fuzz/heap.h"
#include "sdk_live_fixture.h"

namespace stgs::testing {
namespace {

constexpr std::uint32_t kFrames = 15;

bool is_ok_or_out_of_memory(stgs_result result) {
  return result == STGS_OK || result == STGS_ERROR_OUT_OF_MEMORY;
}

// Fails the nth allocation of `call`, which must be single-threaded to be deterministic. Returns
// whether there was an nth allocation.
template <typename Call>
bool with_failing_allocation(int n, const Call& call) {
  fuzz::fail_requests(n, n);
  call();
  const bool failed = fuzz::have_failed();
  fuzz::fail_requests(0, 0);
  return failed;
}

stgs_record_settings single_threaded_settings() {
  stgs_record_settings settings;
  REQUIRE(stgs_record_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.sync = 0;
  settings.threads = 1;
  return settings;
}

// Records two fragments and returns the bytes of the file.
Bytes record(const std::string& path, const stgs_fragment& fragment) {
  const stgs_record_settings settings = single_threaded_settings();
  const RecorderPtr recorder = make_recorder();
  REQUIRE(stgs_recorder_begin(recorder.get(), path.c_str(), &settings) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &fragment) == STGS_OK);
  REQUIRE(stgs_recorder_append(recorder.get(), &fragment) == STGS_OK);
  REQUIRE(stgs_recorder_close(recorder.get()) == STGS_OK);
  return bytes_of(path);
}

}  // namespace

TEST_CASE("recording survives any failing allocation", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const Primitives cloud(40);
  const stgs_fragment fragment = cloud.fragment(kFrames);
  const Bytes expected = record(folder / "expected.stgs", fragment);
  const stgs_record_settings settings = single_threaded_settings();
  int failures = 0;
  // Repeats a failed call.
  const auto call_with_failure = [&](int n, const auto& call) {
    stgs_result result = STGS_OK;
    const bool failed = with_failing_allocation(n, [&] { result = call(); });
    if (result != STGS_OK) {
      ++failures;
      INFO("allocation " << n << ": " << result);
      REQUIRE(is_ok_or_out_of_memory(result));
      REQUIRE(call() == STGS_OK);
    }
    return failed;
  };
  bool failed = true;
  for (int n = 1; failed; n += n < 100 ? 1 : 23) {
    fs::remove(path);
    RecorderPtr recorder = make_recorder();
    failed = call_with_failure(
        n, [&] { return stgs_recorder_begin(recorder.get(), path.c_str(), &settings); });
    const auto append = [&] { return stgs_recorder_append(recorder.get(), &fragment); };
    failed |= call_with_failure(n, append);
    recorder = make_recorder();
    failed |= call_with_failure(
        n, [&] { return stgs_recorder_resume(recorder.get(), path.c_str(), &settings); });
    failed |= call_with_failure(n, append);
    failed |= call_with_failure(n, [&] { return stgs_recorder_close(recorder.get()); });
    INFO("allocation " << n);
    REQUIRE((bytes_of(path) == expected));
  }
  CHECK(failures > 200);
}

TEST_CASE("packing survives any failing allocation", "[sdk]") {
  const TemporaryFolder folder;
  const std::string scene = folder / "scene.stgs", output = folder / "packed.stgs";
  const Primitives cloud(40);
  record(scene, cloud.fragment(kFrames));
  const ObservedEncoder encoder(1);
  REQUIRE(stgs_encoder_pack(encoder.get(), scene.c_str(), output.c_str(), nullptr, nullptr) ==
          STGS_OK);
  const Bytes expected = bytes_of(output);
  bool failed = true;
  int failures = 0;
  for (int n = 1; failed; n += n < 60 ? 1 : 37) {
    fs::remove(output);
    stgs_result result = STGS_OK;
    failed = with_failing_allocation(n, [&] {
      result = stgs_encoder_pack(encoder.get(), scene.c_str(), output.c_str(), nullptr, nullptr);
    });
    INFO("allocation " << n << ": " << result << " " << encoder.error().message);
    REQUIRE(is_ok_or_out_of_memory(result));
    if (result != STGS_OK) {
      ++failures;
      REQUIRE_FALSE(fs::exists(output));
      REQUIRE(stgs_encoder_pack(encoder.get(), scene.c_str(), output.c_str(), nullptr, nullptr) ==
              STGS_OK);
    }
    REQUIRE((bytes_of(output) == expected));
  }
  CHECK(failures > 50);
}

#ifdef STGS_HAS_PREPARE
TEST_CASE("pushing an image survives any failing allocation", "[sdk]") {
  const FilmedCapture filmed;
  stgs_live_settings settings = filmed.settings();
  settings.start_seconds = 3600;  // the session waits for the other cameras
  const LivePtr live = filmed.start(settings);
  const char* const camera = filmed.calibration[0].name;
  const LivePixels pixels = filmed.pixels(0, 0);
  bool failed = true;
  int failures = 0;
  for (int n = 1; failed; ++n) {
    stgs_result result = STGS_OK;
    failed = with_failing_allocation(
        n, [&] { result = stgs_live_push(live.get(), camera, n / filmed.kFps, &pixels.image); });
    INFO("allocation " << n << ": " << result << " " << message_of(live));
    REQUIRE(is_ok_or_out_of_memory(result));
    failures += result != STGS_OK ? 1 : 0;
  }
  CHECK(failures > 1);
  CHECK(stgs_live_push(live.get(), camera, 100, &pixels.image) == STGS_OK);
}
#endif

}  // namespace stgs::testing
