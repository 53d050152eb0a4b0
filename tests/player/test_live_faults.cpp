// SPDX-License-Identifier: Apache-2.0
// Recordings that stall, are replaced or damaged, or whose recorder is killed, during playback.
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <stop_token>

#include "live_fixture.h"

extern char** environ;

namespace stgs::player {
namespace {

using namespace live;

// The head of a recording, and zeros without end. A read requests a stop.
class EndlessSource final : public ByteSource {
 public:
  EndlessSource(int stop_at, std::stop_source stop, int& reads)
      : stop_at_(stop_at), stop_(std::move(stop)), reads_(reads) {}
  std::uint64_t size() const override { return std::uint64_t{1} << 50; }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    if (++reads_ == stop_at_) stop_.request_stop();
    const std::uint64_t head = recording().ends[0];
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = offset + i < head ? recording().bytes[static_cast<std::size_t>(offset + i)] : 0;
    return {};
  }

 private:
  const int stop_at_;
  mutable std::stop_source stop_;
  int& reads_;
  const std::string name_ = "endless";
};

TEST_CASE("an opening that is stopped reads no more") {
  for (const int stop_at : {1, 2, 5}) {
    int reads = 0;
    const std::stop_source stop;
    PlayerSettings settings = quick();
    settings.http.stop = stop.get_token();
    const auto opened =
        Player::from_source(std::make_unique<EndlessSource>(stop_at, stop, reads), settings);
    CHECK(opened.status().code() == StatusCode::kIo);
    CHECK(reads == stop_at);
  }
}

TEST_CASE("a truncated recording is reported, and followed again once it is restored") {
  Viewer viewer(8);
  viewer.play();
  viewer.file->grow(recording().ends[4]);
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kReplaced) == 1; }));
  CHECK(viewer.player->live().growing);
  viewer.file->grow(recording().ends[9]);
  REQUIRE(viewer.wait_for_edge(9));
  viewer.next_fragment(10);
  CHECK(viewer.player->ready());
  CHECK(viewer.count(Kind::kReplaced) == 1);
  viewer.file->grow(20);
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kReplaced) == 2; }));
}

TEST_CASE("a closed recording that is overwritten is reported") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const Recording large = record(0, 2000);  // so that the last read does not contain the beginning
  const Bytes& bytes = large.bytes;
  const auto write = [&](const Bytes& content, std::size_t size) {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    if (!file) file.open(path, std::ios::out | std::ios::binary);
    file.write(reinterpret_cast<const char*>(content.data()), static_cast<std::streamsize>(size));
  };
  write(bytes, large.ends[16]);
  PlayerSettings settings = quick();
  settings.prefetch_seconds = 0.1;
  Viewer viewer(path, settings);
  write(bytes, bytes.size());
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kFinished) == 1; }));
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  // Only the beginning, which is not read again, stays the same.
  Bytes other(bytes.size(), 'x');
  std::copy_n(bytes.begin(), large.ends[0], other.begin());
  write(other, other.size());
  REQUIRE(viewer.player->seek(1.0).ok());
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kReplaced) == 1; }));
  CHECK(viewer.count(Kind::kDamaged) == 0);
  write(bytes, bytes.size());
  REQUIRE(
      viewer.wait_until([&] { return viewer.player->layers() == viewer.player->layer_count(); }));
  CHECK(active_fingerprints(viewer.player->timeline(), 1.0) == active_in(large, 1.0));
  CHECK(viewer.count(Kind::kReplaced) == 1);
}

TEST_CASE("another recording in the same file is followed if the source does not report it") {
  Viewer viewer(8);
  viewer.play();
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  const Recording other = record(500);
  viewer.file->change(other.bytes);
  viewer.file->grow(other.ends[12]);
  REQUIRE(viewer.wait_for_edge(12));
  viewer.player->go_live();
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  const double at = viewer.player->seconds();
  CHECK(active_fingerprints(viewer.player->timeline(), at) == active_in(other, at));
}

TEST_CASE("a link that fails is reported, and followed again") {
  Viewer viewer(6);
  viewer.play();
  viewer.file->fail(true);
  viewer.frames(60);
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kReadFailed) >= 1; }));
  const auto edge = [&] { return viewer.player->live().edge_seconds; };
  CHECK(edge() == Approx(6 * kFragmentSeconds));
  viewer.file->grow(recording().ends[9]);
  viewer.file->fail(false);
  REQUIRE(viewer.wait_for_edge(9));
  REQUIRE(viewer.wait_until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
}

TEST_CASE("a recorder that stalls is reported once, until it continues") {
  PlayerSettings settings = quick();
  settings.live.stall_seconds = 0.05;
  Viewer viewer(6, settings);
  viewer.play();
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kStalled) == 1; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  viewer.tick();
  CHECK(viewer.count(Kind::kStalled) == 1);
  viewer.file->grow(recording().ends[7]);
  REQUIRE(viewer.wait_for_edge(7));
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kStalled) == 2; }));
}

TEST_CASE("content that only a damaged fragment lists stays lost, and the recording is followed") {
  Bytes bytes = recording().bytes;
  bytes[recording().ends[6] - 20] ^= 1;  // in the list of fragment 6
  Viewer viewer(7, quick(), bytes);
  viewer.play();
  viewer.frames(1);
  const auto identity = viewer.player->timeline().identity();
  viewer.file->grow(recording().ends[8]);
  REQUIRE(viewer.wait_for_edge(8));
  REQUIRE(viewer.player->seek(5.5 * kFragmentSeconds).ok());
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  CHECK(viewer.player->timeline().at(viewer.player->seconds()).ok());
  CHECK_FALSE(viewer.player->timeline().damage().empty());
  REQUIRE(viewer.player->seek(7.5 * kFragmentSeconds).ok());
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  const double at = viewer.player->seconds();
  CHECK(active_fingerprints(viewer.player->timeline(), at) == active_in_file(at));
  CHECK(identity == viewer.player->timeline().identity());
  CHECK(viewer.player->timeline().reader().lost_fragments().size() == 1);
}

pid_t spawn_recorder(const std::string& path, int fragments, int milliseconds) {
  std::string program = STGS_RECORD_FRAGMENTS, file = path, count = std::to_string(fragments),
              wait = std::to_string(milliseconds);
  char* arguments[] = {program.data(), file.data(), count.data(), wait.data(), nullptr};
  pid_t pid = 0;
  REQUIRE(::posix_spawn(&pid, program.c_str(), nullptr, nullptr, arguments, environ) == 0);
  return pid;
}

void wait_for_frames(const std::string& path, std::uint32_t frames) {
  for (int k = 0; k < 10000; ++k) {
    const auto reader = SceneReader::open(path);
    if (reader.ok() && !(*reader)->segments().empty() && (*reader)->metadata().frames >= frames) {
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  FAIL("the recorder has not written so many frames");
}

TEST_CASE("a recorder that is killed is reported, and followed when it resumes") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const pid_t recorder = spawn_recorder(path, 1000, 5);
  wait_for_frames(path, 40);
  PlayerSettings settings = quick();
  settings.live.stall_seconds = 0.1;
  Viewer viewer(path, settings);
  viewer.play();
  const double joined = viewer.player->live().edge_seconds;
  REQUIRE(viewer.wait_until([&] { return viewer.player->live().edge_seconds > joined; }));
  REQUIRE(::kill(recorder, SIGKILL) == 0);
  int status = 0;
  REQUIRE(::waitpid(recorder, &status, 0) == recorder);
  {
    // An incomplete append, as a killed recorder leaves it.
    std::ofstream file(path, std::ios::binary | std::ios::app);
    file << "SEGM, and not all of it";
  }
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kStalled) == 1; }));
  const double edge = viewer.player->live().edge_seconds;
  viewer.frames(60);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  auto again = SceneRecorder::resume(path, testing::recording_settings(Profile::kQuantised));
  REQUIRE(again.ok());
  for (int i = 0; i < 3; ++i) {
    const std::uint32_t frames = (*again)->frames();
    REQUIRE((*again)->append(testing::make_fragment(77), frames + testing::kFragmentFrames).ok());
  }
  REQUIRE(viewer.wait_until(
      [&] { return viewer.player->live().edge_seconds > edge + 2.9 * kFragmentSeconds; }));
  REQUIRE(viewer.wait_until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  REQUIRE((*again)->close().ok());
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kFinished) == 1; }));
  CHECK(viewer.count(Kind::kDamaged) == 0);
  CHECK(viewer.count(Kind::kReplaced) == 0);
}

TEST_CASE("a path that names another file is reported") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(recording().bytes.data()),
             static_cast<std::streamsize>(recording().ends[6]));
  Viewer viewer(path);
  viewer.play();
  const std::string other = folder / "other.stgs";
  std::filesystem::copy_file(path, other);
  std::filesystem::rename(other, path);
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kReplaced) == 1; }));
  CHECK(viewer.player->ready());
}

}  // namespace
}  // namespace stgs::player
