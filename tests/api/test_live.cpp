// SPDX-License-Identifier: Apache-2.0
// Playing a recording while it grows.
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <thread>

#include "stgs/player/player.h"
#include "stream/snapshot_source.h"
#include "stretch_fixture.h"

extern char** environ;

namespace stgs::player {
namespace {

using Kind = PlayerEvent::Kind;
using Bytes = std::vector<std::uint8_t>;

constexpr double kFrame = 1.0 / 30, kStretch = testing::kStretchFrames * kFrame;
constexpr std::uint32_t kStretches = 18;  // 6 s

// Removed with what is in it.
struct Folder {
  Folder() {
    std::string made = std::filesystem::temp_directory_path() / "stgs_live_XXXXXX";
    REQUIRE(::mkdtemp(made.data()) != nullptr);
    path = made;
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::string file(const std::string& name) const { return path / name; }
  std::filesystem::path path;
};

Bytes read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(file), {});
}

struct Recording {
  Bytes bytes;
  std::vector<std::size_t> ends;  // [i]: when i stretches were complete
  std::size_t closed() const { return bytes.size(); }
};

Recording record(unsigned first) {
  const Folder folder;
  const std::string path = folder.file("live.stgs");
  auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                        testing::recording_settings(Profile::kQuantised));
  REQUIRE(recorder.ok());
  Recording out;
  out.ends.push_back((*recorder)->bytes());
  for (std::uint32_t i = 0; i < kStretches; ++i) {
    const Gaussians4D stretch = testing::stretch(first + i, 200);
    REQUIRE((*recorder)->append(stretch, (i + 1) * testing::kStretchFrames).ok());
    out.ends.push_back((*recorder)->bytes());
  }
  REQUIRE((*recorder)->close().ok());
  out.bytes = read_file(path);
  return out;
}

const Recording& recording() {
  static const Recording recording = record(0);
  return recording;
}

// A file that grows as it is told, and the reads of it.
class Growth {
 public:
  struct Read {
    std::uint64_t offset = 0, bytes = 0;
  };
  explicit Growth(const Bytes& bytes = recording().bytes) : bytes_(bytes) {}

  void grow(std::size_t size) {
    const std::lock_guard lock(mutex_);
    size_ = size;
  }
  void change(Bytes bytes) {
    const std::lock_guard lock(mutex_);
    bytes_ = std::move(bytes);
  }
  void fail(bool failing) {
    const std::lock_guard lock(mutex_);
    failing_ = failing;
  }
  std::vector<Read> reads() {
    const std::lock_guard lock(mutex_);
    return reads_;
  }
  Result<std::size_t> size() {
    const std::lock_guard lock(mutex_);
    if (failing_) return io_error("the link is down");
    return size_;
  }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) {
    const std::lock_guard lock(mutex_);
    if (failing_) return io_error("the link is down");
    STGS_TRY(check_range("the recording", size_, offset, out.size()));
    reads_.push_back({offset, out.size()});
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }

 private:
  std::mutex mutex_;
  Bytes bytes_;
  std::size_t size_ = 0;
  bool failing_ = false;
  std::vector<Read> reads_;
};

class GrowingSource final : public ByteSource {
 public:
  explicit GrowingSource(std::shared_ptr<Growth> file)
      : file_(std::move(file)), size_(*file_->size()) {}
  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return name_; }
  bool may_grow() const override { return true; }
  Result<Change> refresh(std::uint64_t kept) override {
    STGS_ASSIGN(const std::size_t size, file_->size());
    if (size < kept) return Change::kReplaced;
    return size_.exchange(size) == size ? Change::kNone : Change::kResized;
  }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return file_->read(offset, out);
  }

 private:
  std::shared_ptr<Growth> file_;
  std::atomic<std::uint64_t> size_;
  std::string name_ = "the recording";
};

PlayerSettings quick() {
  PlayerSettings settings;
  settings.live.behind_seconds = 0.5;
  settings.live.poll_seconds = 0.001;
  settings.live.stall_seconds = 1000;
  settings.retry_seconds = 0.01;
  settings.resume_seconds = 0.1;
  return settings;
}

// A viewer with a clock of his own; the file's reader has the machine's.
struct Viewer {
  explicit Viewer(std::uint32_t stretches, const PlayerSettings& settings = quick(),
                  const Bytes& bytes = recording().bytes)
      : file(std::make_shared<Growth>(bytes)) {
    file->grow(recording().ends[stretches]);
    auto opened = Player::over(std::make_unique<GrowingSource>(file), settings);
    REQUIRE(opened.ok());
    player = std::move(*opened);
  }
  explicit Viewer(const std::string& path, const PlayerSettings& settings = quick()) {
    auto opened = Player::open(path, settings);
    INFO(opened.status().message());
    REQUIRE(opened.ok());
    player = std::move(*opened);
  }

  void tick() {
    player->advance(now);
    for (PlayerEvent& event : player->take_events()) events.push_back(std::move(event));
  }
  // Waits, by a clock that stands still.
  bool until(const std::function<bool()>& holds) {
    for (int k = 0; k < 4000; ++k) {
      tick();
      if (holds()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return false;
  }
  // So many frames pass; what is next is there or not coming.
  void frames(int count, const std::function<void()>& at_each = {}) {
    for (int k = 0; k < count; ++k) {
      now += kFrame;
      tick();
      if (at_each) at_each();
    }
  }
  bool at_edge_of(std::uint32_t stretches) {
    return until([&] {
      return !player->live().growing ||
             player->live().edge_seconds == Approx(stretches * kStretch).margin(1e-6);
    });
  }
  // The time of a stretch passes, the file has so many, and all is fetched that play needs of them.
  void next_stretch(std::uint32_t stretches, const std::function<void()>& at_each = {}) {
    frames(testing::kStretchFrames, at_each);
    file->grow(recording().ends[stretches]);
    REQUIRE(at_edge_of(stretches));
    REQUIRE(until([&] { return has(player->seconds(), stretches * kStretch - 1e-6); }));
  }
  bool has(double begin, double end) const {
    const auto ranges = player->buffered();
    return std::any_of(ranges.begin(), ranges.end(), [&](const TimeRange& range) {
      return range.begin <= begin && end <= range.end;
    });
  }
  void play() {
    player->play();
    REQUIRE(until([&] { return player->state() == PlayerState::kPlaying; }));
    if (!player->live().growing) return;
    REQUIRE(until([&] { return has(player->seconds(), player->live().edge_seconds - 1e-6); }));
  }
  int count(Kind kind) const {
    return static_cast<int>(std::count_if(events.begin(), events.end(),
                                          [&](const PlayerEvent& e) { return e.kind == kind; }));
  }

  std::shared_ptr<Growth> file;
  std::unique_ptr<Player> player;
  std::vector<PlayerEvent> events;
  double now = 100;
};

std::multiset<std::string> alive(Timeline& timeline, double seconds) {
  const auto active = timeline.at(seconds);
  REQUIRE(active.ok());
  std::multiset<std::string> out;
  for (const auto& part : active->parts) {
    const auto prints = testing::fingerprints(part.set->gather(*part.candidates));
    out.insert(prints.begin(), prints.end());
  }
  return out;
}

std::multiset<std::string> alive_in(const Recording& recording, double seconds) {
  auto reader = SceneReader::open(memory_source(recording.bytes));
  REQUIRE(reader.ok());
  return alive(*Timeline::over(std::move(*reader)), seconds);
}

std::multiset<std::string> alive_in_file(double seconds) {
  return alive_in(recording(), seconds);
}

TEST_CASE("a viewer joins in the middle, follows the edge, sees all and comes to the end") {
  Viewer viewer(6);
  CHECK(viewer.player->live().growing);
  CHECK(viewer.player->live().following);
  CHECK(viewer.player->seconds() == Approx(6 * kStretch - 0.5).margin(kFrame));
  viewer.play();
  const double joined = viewer.player->seconds();
  std::set<int> seen;
  double last = joined;
  const auto look = [&] {
    const double moment = viewer.player->seconds();
    CHECK(moment > last);
    CHECK(moment < last + 1.2 * kFrame);  // no jump: a tenth faster at most
    last = moment;
    seen.insert(static_cast<int>(moment / kStretch));
    REQUIRE(viewer.player->ready());
  };
  for (std::uint32_t i = 7; i <= kStretches; ++i) {
    viewer.next_stretch(i, look);
    const LiveState live = viewer.player->live();
    CHECK(live.following);
    CHECK(live.behind_seconds == Approx(live.wanted_seconds).margin(0.1));
    const double moment = viewer.player->seconds();
    REQUIRE(viewer.until([&] { return viewer.player->settled(); }));
    CHECK(alive(viewer.player->timeline(), moment) == alive_in_file(moment));
  }
  for (int i = static_cast<int>(joined / kStretch); i < static_cast<int>(kStretches) - 1; ++i) {
    CHECK(seen.count(i) == 1);
  }
  CHECK(viewer.count(Kind::kBuffering) == 0);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.until([&] { return !viewer.player->live().growing; }));
  CHECK(viewer.count(Kind::kFinished) == 1);
  viewer.frames(30);
  CHECK(viewer.player->state() == PlayerState::kEnded);
  CHECK(viewer.player->seconds() == Approx(kStretches * kStretch - kFrame).margin(kFrame));
  CHECK(viewer.count(Kind::kEnded) == 1);
  // A clip like any other now.
  viewer.player->play();
  REQUIRE(viewer.until([&] { return viewer.player->ready(); }));
  CHECK(viewer.player->seconds() == 0);
}

TEST_CASE("play that runs ahead of the edge stands still, says so, and goes on") {
  Viewer viewer(6);
  viewer.play();
  viewer.frames(40);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.count(Kind::kBuffering) == 1);
  const double stood = viewer.player->seconds();
  CHECK(stood < 6 * kStretch);
  CHECK(stood > 6 * kStretch - 1.5 * kFrame);
  viewer.file->grow(recording().ends[8]);
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  CHECK(viewer.count(Kind::kResumed) == 2);
  viewer.frames(3);
  CHECK(viewer.player->seconds() > stood);
}

TEST_CASE("what has been recorded can be paused in and sought, and the edge found again") {
  Viewer viewer(9);
  viewer.play();
  viewer.next_stretch(10);
  viewer.player->pause();
  CHECK_FALSE(viewer.player->live().following);
  const double paused = viewer.player->seconds();
  viewer.next_stretch(11);
  viewer.next_stretch(12);
  CHECK(viewer.player->seconds() == paused);
  CHECK(viewer.player->live().growing);
  REQUIRE(viewer.player->seek_frame(7).ok());
  CHECK(viewer.player->seek_frame(12 * testing::kStretchFrames).code() == StatusCode::kUsage);
  REQUIRE(viewer.until([&] { return viewer.player->settled(); }));
  CHECK(alive(viewer.player->timeline(), viewer.player->seconds()) == alive_in_file(7 * kFrame));
  viewer.play();
  REQUIRE(viewer.until([&] { return viewer.has(7 * kFrame, 18 * kFrame); }));
  viewer.frames(10);
  CHECK(viewer.player->seconds() == Approx(17 * kFrame).margin(1e-6));  // as fast as it is
  CHECK_FALSE(viewer.player->live().following);
  viewer.player->go_live();
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  const LiveState live = viewer.player->live();
  CHECK(live.following);
  CHECK(live.behind_seconds == Approx(live.wanted_seconds).margin(0.05));
  // Further than the edge is the edge; and who plays there faster comes to follow it.
  REQUIRE(viewer.player->seek(1e6).ok());
  viewer.tick();
  CHECK(viewer.player->seconds() < 12 * kStretch);
  REQUIRE(viewer.player->seek(10 * kStretch).ok());
  REQUIRE(viewer.player->set_rate(4).ok());
  viewer.play();
  viewer.frames(10);
  CHECK(viewer.player->live().following);
}

TEST_CASE("a distance to the edge is made up for a tenth faster, a great one by a jump") {
  PlayerSettings settings = quick();
  settings.live.skip_seconds = 1;
  Viewer viewer(6, settings);
  viewer.play();
  for (std::uint32_t i = 7; i <= 10; ++i) viewer.next_stretch(i);
  // The application stands still for a second, of which it plays .25 s.
  viewer.now += 1;
  viewer.tick();
  viewer.file->grow(recording().ends[13]);
  REQUIRE(viewer.at_edge_of(13));
  REQUIRE(viewer.until([&] { return viewer.has(viewer.player->seconds(), 13 * kStretch - 1e-6); }));
  const LiveState live = viewer.player->live();
  CHECK(live.behind_seconds - live.wanted_seconds == Approx(0.75).margin(0.1));
  const double before = viewer.player->seconds();
  viewer.next_stretch(14);
  const double passed = viewer.player->seconds() - before;
  CHECK(passed > 1.03 * kStretch);
  CHECK(passed < 1.1 * kStretch + 1e-6);
  CHECK(viewer.count(Kind::kSkipped) == 0);
  // And for longer than is made up for.
  viewer.now += 4 * kStretch;
  viewer.tick();
  viewer.file->grow(recording().ends[kStretches]);
  REQUIRE(viewer.at_edge_of(kStretches));
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kSkipped) == 1; }));
  const LiveState skipped = viewer.player->live();
  CHECK(skipped.behind_seconds < skipped.wanted_seconds + 1.01);
}

TEST_CASE("nothing of a recording that grows is read twice") {
  Viewer viewer(3);
  viewer.play();
  for (std::uint32_t i = 4; i <= kStretches; ++i) viewer.next_stretch(i);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.until([&] { return !viewer.player->live().growing; }));
  std::vector<int> times(recording().bytes.size());
  for (const Growth::Read& read : viewer.file->reads()) {
    for (std::uint64_t k = 0; k < read.bytes; ++k) ++times[read.offset + k];
  }
  const auto body = times.begin() + static_cast<std::ptrdiff_t>(recording().ends[0]);
  CHECK(*std::max_element(body, times.end()) == 1);
}

TEST_CASE("what opening a reader has read of the index is not read again, and does not pile up") {
  const auto file = std::make_shared<Growth>();
  file->grow(recording().ends[1]);
  const auto source = std::make_shared<PieceSource>(std::make_unique<GrowingSource>(file),
                                                    std::pmr::get_default_resource());
  IndexCache cache;
  std::uint64_t before = 0, most = 0;
  for (std::uint32_t i = 1; i <= kStretches; ++i) {
    file->grow(recording().ends[i]);
    REQUIRE(source->refresh(0).ok());
    const auto reader =
        open_snapshot(source, cache, ReadLimits{}, std::pmr::get_default_resource());
    REQUIRE(reader.ok());
    CHECK((*reader)->metadata().frames == i * testing::kStretchFrames);
    const auto reads = file->reads();
    for (std::size_t k = before; k < reads.size() && i > 1; ++k) {
      CHECK(reads[k].offset >= recording().ends[i - 1]);
    }
    before = reads.size();
    most = std::max(most, cache.bytes());
    CHECK(cache.bytes() <= recording().ends[i]);
  }
  CHECK(most > 0);
}

TEST_CASE("a file that becomes shorter is told, and followed again where it is whole again") {
  Viewer viewer(8);
  viewer.play();
  viewer.file->grow(recording().ends[4]);
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kReplaced) == 1; }));
  CHECK(viewer.player->live().growing);
  viewer.file->grow(recording().ends[9]);
  REQUIRE(viewer.at_edge_of(9));
  viewer.next_stretch(10);
  CHECK(viewer.player->ready());
  CHECK(viewer.count(Kind::kReplaced) == 1);
  viewer.file->grow(20);
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kReplaced) == 2; }));
}

TEST_CASE("another recording that its source takes for the same is followed as what it is") {
  Viewer viewer(8);
  viewer.play();
  REQUIRE(viewer.until([&] { return viewer.player->settled(); }));
  const Recording other = record(500);
  viewer.file->change(other.bytes);
  viewer.file->grow(other.ends[12]);
  REQUIRE(viewer.at_edge_of(12));
  viewer.player->go_live();
  REQUIRE(viewer.until([&] { return viewer.player->settled(); }));
  const double moment = viewer.player->seconds();
  CHECK(alive(viewer.player->timeline(), moment) == alive_in(other, moment));
}

TEST_CASE("a link that goes down is told once, and made up for") {
  Viewer viewer(6);
  viewer.play();
  viewer.file->fail(true);
  viewer.frames(60);
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kLost) >= 1; }));
  const auto edge = [&] { return viewer.player->live().edge_seconds; };
  CHECK(edge() == Approx(6 * kStretch));
  viewer.file->grow(recording().ends[9]);
  viewer.file->fail(false);
  REQUIRE(viewer.at_edge_of(9));
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
}

TEST_CASE("a recorder that adds nothing is told once, until it goes on") {
  PlayerSettings settings = quick();
  settings.live.stall_seconds = 0.05;
  Viewer viewer(6, settings);
  viewer.play();
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kStalled) == 1; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  viewer.tick();
  CHECK(viewer.count(Kind::kStalled) == 1);
  viewer.file->grow(recording().ends[7]);
  REQUIRE(viewer.at_edge_of(7));
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kStalled) == 2; }));
}

TEST_CASE("memory stays within its budget however long a recording is followed") {
  PlayerSettings settings = quick();
  settings.memory_budget = recording().bytes.size() / 2;
  Viewer viewer(3, settings);
  viewer.player->play();
  std::uint64_t most = 0;
  for (std::uint32_t i = 4; i <= kStretches; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.at_edge_of(i));
    viewer.frames(testing::kStretchFrames, [&] {
      const double at = viewer.player->seconds();
      const double next = std::min(at + 2 * kFrame, i * kStretch - 1e-6);
      REQUIRE(viewer.until(
          [&] { return viewer.has(at, next) && viewer.player->state() == PlayerState::kPlaying; }));
      most = std::max(most, viewer.player->statistics().memory_bytes);
    });
  }
  CHECK(most <= settings.memory_budget);
  CHECK(most > settings.memory_budget / 4);
  CHECK(viewer.player->seconds() > (kStretches - 6) * kStretch);
}

TEST_CASE("what a damaged fragment hides is shown once a later one lists it again") {
  // Fragment i lists as many stretches as the greatest power of two that divides i: 7 lists its own
  // alone, and 8 all.
  Bytes bytes = recording().bytes;
  bytes[recording().ends[6] - 20] ^= 1;  // of what fragment 6 lists
  Viewer viewer(7, quick(), bytes);
  viewer.play();
  viewer.frames(1);
  CHECK_FALSE(viewer.player->timeline().damage().empty());
  const auto identity = viewer.player->timeline().identity();
  viewer.file->grow(recording().ends[8]);
  REQUIRE(viewer.at_edge_of(8));
  REQUIRE(viewer.player->seek(5.5 * kStretch).ok());
  REQUIRE(viewer.until([&] { return viewer.player->settled(); }));
  const double moment = viewer.player->seconds();
  CHECK(alive(viewer.player->timeline(), moment) == alive_in_file(moment));
  CHECK(identity != viewer.player->timeline().identity());
  CHECK(viewer.player->timeline().damage().empty());
}

TEST_CASE("a recording that does not grow is a clip like any other") {
  SECTION("as it is asked for") {
    PlayerSettings settings = quick();
    settings.live.follow = false;
    Viewer viewer(6, settings);
    CHECK_FALSE(viewer.player->live().growing);
    CHECK(viewer.player->seconds() == 0);
    viewer.play();
    viewer.file->grow(recording().ends[9]);
    REQUIRE(viewer.until([&] { return viewer.has(0, 6 * kStretch); }));
    viewer.frames(70);
    CHECK(viewer.player->state() == PlayerState::kEnded);
    CHECK(viewer.player->seconds() == Approx(6 * kStretch - kFrame));
  }
  SECTION("closed") {
    Viewer viewer(kStretches);
    viewer.file->grow(recording().closed());
    auto opened = Player::over(std::make_unique<GrowingSource>(viewer.file), quick());
    REQUIRE(opened.ok());
    CHECK_FALSE((*opened)->live().growing);
    CHECK((*opened)->seconds() == 0);
  }
  SECTION("in memory") {
    Bytes bytes = recording().bytes;
    bytes.resize(recording().ends[6]);
    auto opened = Player::over(memory_source(std::move(bytes)), quick());
    REQUIRE(opened.ok());
    CHECK_FALSE((*opened)->live().growing);
  }
}

TEST_CASE("a recording is joined before its first stretch") {
  Viewer viewer(0);
  viewer.player->play();
  viewer.frames(5);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.player->seconds() == 0);
  for (std::uint32_t i = 1; i <= 5; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.at_edge_of(i));
    REQUIRE(
        viewer.until([&] { return viewer.has(viewer.player->seconds(), i * kStretch - 1e-6); }));
    viewer.frames(testing::kStretchFrames);
  }
  CHECK(viewer.player->seconds() > kStretch);
  CHECK(viewer.player->live().following);
}

pid_t spawn_recorder(const std::string& path, int stretches, int milliseconds) {
  std::string program = STGS_RECORD_STRETCHES, file = path, count = std::to_string(stretches),
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
  FAIL("the recorder has not come so far");
}

TEST_CASE("a recorder that is killed is waited for, and followed when it goes on") {
  const Folder folder;
  const std::string path = folder.file("live.stgs");
  const pid_t recorder = spawn_recorder(path, 1000, 5);
  wait_for_frames(path, 40);
  PlayerSettings settings = quick();
  settings.live.stall_seconds = 0.1;
  Viewer viewer(path, settings);
  viewer.play();
  const double joined = viewer.player->live().edge_seconds;
  REQUIRE(viewer.until([&] { return viewer.player->live().edge_seconds > joined; }));
  REQUIRE(::kill(recorder, SIGKILL) == 0);
  int status = 0;
  REQUIRE(::waitpid(recorder, &status, 0) == recorder);
  {
    // What a kill within an append leaves.
    std::ofstream file(path, std::ios::binary | std::ios::app);
    file << "SEGM, and not all of it";
  }
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kStalled) == 1; }));
  const double edge = viewer.player->live().edge_seconds;
  viewer.frames(60);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  auto again = SceneRecorder::resume(path, testing::recording_settings(Profile::kQuantised));
  REQUIRE(again.ok());
  for (int i = 0; i < 3; ++i) {
    const std::uint32_t frames = (*again)->frames();
    REQUIRE((*again)->append(testing::stretch(77), frames + testing::kStretchFrames).ok());
  }
  REQUIRE(viewer.until([&] { return viewer.player->live().edge_seconds > edge + 2.9 * kStretch; }));
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  REQUIRE((*again)->close().ok());
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kFinished) == 1; }));
  CHECK(viewer.count(Kind::kDamaged) == 0);
  CHECK(viewer.count(Kind::kReplaced) == 0);
}

TEST_CASE("a file that another takes the place of is told") {
  const Folder folder;
  const std::string path = folder.file("live.stgs");
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(recording().bytes.data()),
             static_cast<std::streamsize>(recording().ends[6]));
  Viewer viewer(path);
  viewer.play();
  const std::string other = folder.file("other.stgs");
  std::filesystem::copy_file(path, other);
  std::filesystem::rename(other, path);
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kReplaced) == 1; }));
  CHECK(viewer.player->ready());
}

}  // namespace
}  // namespace stgs::player
