// SPDX-License-Identifier: Apache-2.0
// Faults while recording: concurrent access to the file, full disks, and extreme input.
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <csignal>
#include <functional>

#include "fixtures/recording_fixture.h"

namespace {

std::function<void()> before_lock;  // called once

}  // namespace

// Replaces the C library's function.
extern "C" int flock(int descriptor, int operation) noexcept {
  if (const auto call = std::exchange(before_lock, nullptr)) call();
  return static_cast<int>(::syscall(SYS_flock, descriptor, operation));
}

namespace stgs::testing {
namespace {

namespace fs = std::filesystem;

// Limits the files of this process to `bytes` bytes during its lifetime.
class FullDisk {
 public:
  explicit FullDisk(std::uint64_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    REQUIRE(::getrlimit(RLIMIT_FSIZE, &previous_) == 0);
    const rlimit small{bytes, previous_.rlim_max};
    REQUIRE(::setrlimit(RLIMIT_FSIZE, &small) == 0);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &previous_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit previous_{};
  void (*handler_)(int);
};

std::unique_ptr<SceneRecorder> create_recorder(const std::string& path) {
  auto recorder = SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
  REQUIRE(recorder.ok());
  return std::move(*recorder);
}

void append(SceneRecorder& recorder, std::uint32_t i) {
  REQUIRE(recorder.append(make_fragment(i), (i + 1) * kFragmentFrames).ok());
}

}  // namespace

TEST_CASE("fragments that another recorder appends before the lock is taken are preserved") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto first = create_recorder(path);
  append(*first, 0);
  const bool closes = GENERATE(false, true);
  before_lock = [&] {
    append(*first, 1);
    append(*first, 2);
    if (closes) REQUIRE(first->close().ok());
    first.reset();
  };
  auto second = SceneRecorder::resume(path, recording_settings());
  CHECK(open_scene(path)->metadata().frames == 3 * kFragmentFrames);
  if (closes) {
    CHECK(second.status().code() == StatusCode::kUsage);
    return;
  }
  REQUIRE(second.ok());
  CHECK((*second)->frames() == 3 * kFragmentFrames);
  append(**second, 3);
  REQUIRE((*second)->close().ok());
  CHECK(issues_of(bytes_of(path)).empty());
}

TEST_CASE("a file that replaces a recording before the lock is taken is not truncated") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs", other = folder / "other.stgs";
  record(path, 1, false);
  record(other, 3, false);
  const auto before = bytes_of(other);
  before_lock = [&] { fs::rename(other, path); };
  CHECK(SceneRecorder::resume(path, recording_settings()).status().code() == StatusCode::kIo);
  CHECK(bytes_of(path) == before);
  REQUIRE(SceneRecorder::resume(path, recording_settings()).ok());
}

TEST_CASE("a failed creation of a recording leaves no file and can be retried") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  for (const std::uint64_t limit : {0u, 100u}) {
    const FullDisk disk(limit);
    const auto recorder =
        SceneRecorder::create(path, recording_metadata(), 1, recording_settings());
    CHECK(recorder.status().code() == StatusCode::kIo);
    CHECK_FALSE(fs::exists(path));
  }
  // By then the path belongs to another file.
  before_lock = [&] {
    fs::remove(path);
    std::ofstream(path) << "of another";
  };
  {
    const FullDisk disk(100);
    CHECK_FALSE(SceneRecorder::create(path, recording_metadata(), 1, recording_settings()).ok());
  }
  CHECK(bytes_of(path).size() == 10);
  fs::remove(path);
  append(*create_recorder(path), 0);
}

TEST_CASE("a full disk ends a recording, which can be resumed") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const bool closing = GENERATE(false, true);
  auto recorder = create_recorder(path);
  append(*recorder, 0);
  const auto before = bytes_of(path);
  {
    const FullDisk disk(before.size() + 50);
    const Status status =
        closing ? recorder->close() : recorder->append(make_fragment(1), 2 * kFragmentFrames);
    CHECK(status.code() == StatusCode::kIo);
  }
  CHECK(bytes_of(path) == before);
  CHECK_FALSE(recorder->is_open());
  CHECK(recorder->frames() == kFragmentFrames);
  CHECK(recorder->primitives() == 60);
  CHECK(recorder->bytes() == before.size());
  CHECK(recorder->append(make_fragment(1), 2 * kFragmentFrames).code() == StatusCode::kUsage);
  CHECK(recorder->close().code() == StatusCode::kUsage);
  // While the recorder that has ended still exists.
  auto next = SceneRecorder::resume(path, recording_settings());
  REQUIRE(next.ok());
  append(**next, 1);
  REQUIRE((*next)->close().ok());
  CHECK(issues_of(bytes_of(path)).empty());
}

TEST_CASE("a recorder counts primitives that are never visible as dropped") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder =
      SceneRecorder::create(path, recording_metadata(), 1, recording_settings(Profile::kQuantised));
  REQUIRE(recorder.ok());
  append(**recorder, 0);
  Gaussians4D late = make_fragment(1);
  for (float& t : late.time) t += 10000;
  late.sigma.assign(60, 1);
  late.radius.assign(60, 1);
  late.time[7] = 5;
  REQUIRE((*recorder)->append(late, 2 * kFragmentFrames).ok());
  CHECK((*recorder)->primitives() == 61);
  CHECK((*recorder)->dropped() == 59);
  recorder->reset();
  recorder = SceneRecorder::resume(path, recording_settings(Profile::kQuantised));
  REQUIRE(recorder.ok());
  CHECK((*recorder)->primitives() == 61);
  CHECK((*recorder)->dropped() == 0);
}

TEST_CASE("always visible primitives stay so in the longest possible fragment") {
  const TemporaryFolder folder;
  for (const std::uint32_t frames : {2'000'000'000u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu}) {
    const std::string path = folder / fmt::format("{}.stgs", frames);
    auto recorder = SceneRecorder::create(path, recording_metadata(), 1,
                                          recording_settings(Profile::kQuantised));
    REQUIRE(recorder.ok());
    Gaussians4D set = make_fragment(0, 3);
    set.time.assign(3, 0);
    set.sigma.assign(3, 1);
    set.radius.assign(3, 2.0f * static_cast<float>(frames));
    REQUIRE((*recorder)->append(set, frames).ok());
    const auto decoded = read_scene(path);
    REQUIRE(decoded.ok());
    const Gaussians4D& found = decoded->gaussians;
    REQUIRE(found.size() == 3);
    for (std::size_t i = 0; i < 3; ++i) {
      INFO(frames << ": " << found.time[i] << " +- " << found.radius[i]);
      CHECK(found.time[i] - found.radius[i] <= 0);
      CHECK(double{found.time[i]} + found.radius[i] >= frames);
    }
    CHECK(issues_of(bytes_of(path)).empty());
  }
}

}  // namespace stgs::testing
