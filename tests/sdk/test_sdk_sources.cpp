// SPDX-License-Identifier: Apache-2.0
// Sources of scenes and players: pipes, stalled reads and oversized memory.
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "fixtures/temporary_folder.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

// A pipe without a writer. SIGALRM ends a test that waits for one.
class Pipe {
 public:
  Pipe() {
    REQUIRE(::mkfifo(path_.c_str(), 0600) == 0);
    ::alarm(60);
  }
  ~Pipe() { ::alarm(0); }
  const std::string& path() const { return path_; }

 private:
  const TemporaryFolder folder_;
  const std::string path_ = folder_ / "pipe";
};

}  // namespace

TEST_CASE("a pipe is rejected with its path, without waiting for a writer", "[sdk]") {
  const Pipe pipe;
  const std::string message = pipe.path() + ": not a regular file";
  const auto source = open_file(pipe.path());
  CHECK(source.status().code() == StatusCode::kIo);
  CHECK(source.status().message() == message);
  const ScenePtr scene = make_scene();
  CHECK(stgs_scene_open(scene.get(), pipe.path().c_str()) == STGS_ERROR_IO);
  CHECK(error_of(scene.get()).message == message);
  const PlayerPtr player = make_player();
  REQUIRE(stgs_player_open(player.get(), pipe.path().c_str()) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_IO);
  CHECK(error_of(player.get()).message == message);
}

TEST_CASE("a stalled read does not delay a seek to another time", "[sdk]") {
  DeferredSource file(clip_file());
  stgs_player_settings settings = player_settings();
  settings.max_reads_in_flight = 1;
  settings.prefetch_seconds = settings.resume_seconds = 0.1;
  const PlayerPtr player = make_player(&settings);
  const stgs_async_io io = file.io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status& status) {
    file.complete(0);
    return status.state != STGS_PLAYER_OPENING && status.is_complete != 0;
  }));
  REQUIRE(stgs_player_seek(player.get(), 0.9) == STGS_OK);
  REQUIRE(wait_until([&] { return file.pending() == 1; }));
  CHECK(update(player.get(), 0).ready == 0);
  REQUIRE(stgs_player_seek(player.get(), 1.9) == STGS_OK);
  CHECK(update_until(player.get(), 0, [&](const stgs_player_status& status) {
    int before = 0;  // the first read stays pending
    file.complete_each([&] { return before++ == 0 ? std::nullopt : std::optional(0); });
    return status.ready != 0;
  }));
  CHECK(file.pending() >= 1);
}

TEST_CASE("a scene does not copy memory larger than max_file_bytes", "[sdk]") {
  int requests = 0;
  stgs_allocator allocator{};
  allocator.struct_size = sizeof allocator;
  allocator.user = &requests;
  allocator.allocate = [](void* user, std::size_t, std::size_t) -> void* {
    ++*static_cast<int*>(user);
    return nullptr;
  };
  allocator.free = [](void*, void*, std::size_t, std::size_t) {};
  stgs_scene_settings settings = scene_settings();
  settings.allocator = &allocator;
  const auto file = sdk_file();
  const auto open = [&](std::uint64_t max_file_bytes, std::size_t bytes) {
    settings.max_file_bytes = max_file_bytes;
    return stgs_scene_open_memory_copy(make_scene(&settings).get(), file.data(), bytes);
  };
  CHECK(open(file.size() - 1, file.size()) == STGS_ERROR_LIMIT);
  CHECK(open(scene_settings().max_file_bytes, SIZE_MAX) == STGS_ERROR_LIMIT);
  CHECK(open(UINT64_MAX, SIZE_MAX) == STGS_ERROR_OUT_OF_MEMORY);
  CHECK(requests == 0);
  CHECK(open(file.size(), file.size()) == STGS_ERROR_OUT_OF_MEMORY);
  CHECK(requests == 1);
}

}  // namespace stgs::testing
