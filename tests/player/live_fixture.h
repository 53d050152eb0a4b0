// SPDX-License-Identifier: Apache-2.0
// Recordings that grow on request, and viewers of them.
#pragma once

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <thread>

#include "active_primitives.h"
#include "catch.h"
#include "fixtures/fragment_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/player/player.h"

namespace stgs::player::live {

using Kind = PlayerEvent::Kind;
using Bytes = std::vector<std::uint8_t>;

inline constexpr double kFrameSeconds = 1.0 / 30,
                        kFragmentSeconds = testing::kFragmentFrames * kFrameSeconds;
inline constexpr std::uint32_t kFragments = 18;  // 6 s

inline Bytes read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(file), {});
}

struct Recording {
  Bytes bytes;
  std::vector<std::size_t> ends;  // [i]: file size with i complete fragments
  std::size_t closed() const { return bytes.size(); }
};

inline Recording record(unsigned first, std::size_t primitives = 200) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                        testing::recording_settings(Profile::kQuantised));
  REQUIRE(recorder.ok());
  Recording out;
  out.ends.push_back((*recorder)->bytes());
  for (std::uint32_t i = 0; i < kFragments; ++i) {
    const Gaussians4D fragment = testing::make_fragment(first + i, primitives);
    REQUIRE((*recorder)->append(fragment, (i + 1) * testing::kFragmentFrames).ok());
    out.ends.push_back((*recorder)->bytes());
  }
  REQUIRE((*recorder)->close().ok());
  out.bytes = read_file(path);
  return out;
}

inline const Recording& recording() {
  static const Recording recording = record(0);
  return recording;
}

// A file that grows on request, and the reads of it. Thread-safe.
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

inline PlayerSettings quick() {
  PlayerSettings settings;
  settings.live.latency_seconds = 0.5;
  settings.live.poll_seconds = 0.001;
  settings.live.stall_seconds = 1000;
  settings.retry_seconds = 0.01;
  settings.resume_seconds = 0.1;
  return settings;
}

// A viewer with a simulated clock; the player polls the file in real time.
struct Viewer {
  explicit Viewer(std::uint32_t fragments, const PlayerSettings& settings = quick(),
                  const Bytes& bytes = recording().bytes)
      : file(std::make_shared<Growth>(bytes)) {
    file->grow(recording().ends[fragments]);
    auto opened = Player::from_source(std::make_unique<GrowingSource>(file), settings);
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
  // Advances at a constant time until holds() is true. Returns false after 8 s.
  bool wait_until(const std::function<bool()>& holds) {
    for (int k = 0; k < 4000; ++k) {
      tick();
      if (holds()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return false;
  }
  // Advances by `count` frames without waiting.
  void frames(int count, const std::function<void()>& at_each_frame = {}) {
    for (int k = 0; k < count; ++k) {
      now += kFrameSeconds;
      tick();
      if (at_each_frame) at_each_frame();
    }
  }
  bool wait_for_edge(std::uint32_t fragments) {
    return wait_until([&] {
      return !player->live().growing ||
             player->live().edge_seconds == Approx(fragments * kFragmentSeconds).margin(1e-6);
    });
  }
  // Advances by one fragment, grows the file to `fragments`, and waits until these are playable.
  void next_fragment(std::uint32_t fragments, const std::function<void()>& at_each_frame = {}) {
    frames(testing::kFragmentFrames, at_each_frame);
    file->grow(recording().ends[fragments]);
    REQUIRE(wait_for_edge(fragments));
    wait_for(fragments * kFragmentSeconds);
  }
  // Waits until everything up to `end` is fetched, then advances once.
  void wait_for(double end) {
    REQUIRE(wait_until([&] { return has(player->seconds(), end - 1e-6); }));
    tick();
  }
  bool has(double begin, double end) const {
    const auto ranges = player->buffered();
    return std::any_of(ranges.begin(), ranges.end(), [&](const TimeRange& range) {
      return range.begin <= begin && end <= range.end;
    });
  }
  void play() {
    player->play();
    REQUIRE(wait_until([&] { return player->state() == PlayerState::kPlaying; }));
    if (!player->live().growing) return;
    wait_for(player->live().edge_seconds);
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

inline std::multiset<std::string> active_in(const Recording& recording, double seconds) {
  auto reader = SceneReader::open(memory_source(recording.bytes));
  REQUIRE(reader.ok());
  return active_fingerprints(*Timeline::from_reader(std::move(*reader)), seconds);
}

inline std::multiset<std::string> active_in_file(double seconds) {
  return active_in(recording(), seconds);
}

}  // namespace stgs::player::live
