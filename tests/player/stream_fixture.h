// SPDX-License-Identifier: Apache-2.0
// A clip behind a link that is slow, stalls or fails, and a player of it.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "active_primitives.h"
#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/player/player.h"

namespace stgs::player {

inline constexpr std::uint32_t kFrames = 90;  // 3 s
using Kind = PlayerEvent::Kind;
using Clock = std::chrono::steady_clock;

// Decides what happens to each read, by its offset. Thread-safe.
class Link {
 public:
  enum class Answer { kBytes, kWait, kFail };

  Answer answer(std::uint64_t offset, std::size_t bytes) {
    std::unique_lock lock(mutex_);
    if (bytes_per_second_ > 0 && offset >= slow_from_) {
      free_ = std::max(free_, Clock::now()) +
              std::chrono::microseconds(
                  static_cast<std::int64_t>(1e6 * static_cast<double>(bytes) / bytes_per_second_));
      const Clock::time_point end = free_;
      lock.unlock();
      std::this_thread::sleep_until(end);
      lock.lock();
    }
    reads_.push_back(offset);
    changed_.notify_all();
    while (!interrupted_ && of(offset) == Answer::kWait) changed_.wait(lock);
    return interrupted_ ? Answer::kFail : of(offset);
  }
  void set(Answer answer, std::uint64_t begin = 0, std::uint64_t end = ~std::uint64_t{0}) {
    const std::lock_guard lock(mutex_);
    answers_.push_back({begin, end, answer});
    changed_.notify_all();
  }
  // Limits the rate that all reads from the offset `begin` on share; 0: no limit.
  void limit(double bytes_per_second, std::uint64_t begin) {
    const std::lock_guard lock(mutex_);
    bytes_per_second_ = bytes_per_second;
    slow_from_ = begin;
  }
  void interrupt() {
    const std::lock_guard lock(mutex_);
    interrupted_ = true;
    changed_.notify_all();
  }
  std::vector<std::uint64_t> reads() {
    const std::lock_guard lock(mutex_);
    return reads_;
  }

 private:
  struct Rule {
    std::uint64_t begin, end;
    Answer answer;
  };
  Answer of(std::uint64_t offset) const {
    for (auto rule = answers_.rbegin(); rule != answers_.rend(); ++rule) {
      if (rule->begin <= offset && offset < rule->end) return rule->answer;
    }
    return Answer::kBytes;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  bool interrupted_ = false;
  double bytes_per_second_ = 0;
  std::uint64_t slow_from_ = 0;
  Clock::time_point free_;
  std::vector<Rule> answers_;
  std::vector<std::uint64_t> reads_;
};

class LinkSource final : public ByteSource {
 public:
  LinkSource(std::vector<std::uint8_t> bytes, std::shared_ptr<Link> link)
      : bytes_(memory_source(std::move(bytes))), link_(std::move(link)) {}
  std::uint64_t size() const override { return bytes_->size(); }
  const std::string& name() const override { return bytes_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    if (link_->answer(offset, out.size()) == Link::Answer::kFail)
      return io_error("the link is down");
    return bytes_->read(offset, out);
  }

 private:
  std::unique_ptr<ByteSource> bytes_;
  std::shared_ptr<Link> link_;
};

// Three tiers with separate spherical harmonics, and segments of 0.2 s or more.
struct Clip {
  Clip() {
    Scene scene = testing::random_scene(4000, 2, kFrames, 3);
    WriteSettings settings;
    settings.profile = Profile::kQuantised;
    settings.chunk_seconds = 0.2;
    auto encoded = encode_scene(scene, settings);
    REQUIRE(encoded.ok());
    bytes = std::move(*encoded);
    reader = std::move(*SceneReader::open(memory_source(bytes)));
    for (const SegmentInfo& segment : reader->segments()) {
      segments_begin = std::min(segments_begin, segment.offset);
    }
  }

  std::vector<std::uint8_t> bytes;
  std::unique_ptr<SceneReader> reader;
  std::uint64_t segments_begin = ~std::uint64_t{0};  // opening reads everything before
};

inline const Clip& clip() {
  static const Clip clip;
  return clip;
}

struct TestPlayer {
  explicit TestPlayer(PlayerSettings settings = {}, std::vector<std::uint8_t> bytes = clip().bytes,
                      const std::function<void(Link&)>& prepare = {}) {
    if (prepare) prepare(*link);
    auto opened = Player::from_source(std::make_unique<LinkSource>(std::move(bytes), link),
                                      settings, [link = link] { link->interrupt(); });
    REQUIRE(opened.ok());
    player = std::move(*opened);
  }

  explicit TestPlayer(std::unique_ptr<Player> opened) : player(std::move(opened)) {}

  // Advances at a constant time until holds() is true. Returns false after 20 s.
  bool wait_until(const std::function<bool()>& holds) {
    for (int k = 0; k < 4000; ++k) {
      player->advance(now);
      for (PlayerEvent& event : player->take_events()) events.push_back(std::move(event));
      if (holds()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  bool wait_complete() {
    return wait_until([&] { return player->layers() == player->layer_count(); });
  }
  // Plays to the end in steps of 1/30 s, and waits where data is missing.
  void play_to_end(const std::function<void()>& at_each_step = {}) {
    REQUIRE(wait_until([&] {
      now += player->state() == PlayerState::kPlaying ? 1.0 / 30 : 0.0;
      if (at_each_step) at_each_step();
      return player->state() == PlayerState::kEnded;
    }));
  }
  int count(Kind kind) const {
    return static_cast<int>(std::count_if(events.begin(), events.end(),
                                          [&](const PlayerEvent& e) { return e.kind == kind; }));
  }

  bool has_event(Kind kind, const std::string& words) const {
    return std::any_of(events.begin(), events.end(), [&](const PlayerEvent& e) {
      return e.kind == kind && e.message.find(words) != std::string::npos;
    });
  }

  std::shared_ptr<Link> link = std::make_shared<Link>();
  std::unique_ptr<Player> player;
  std::vector<PlayerEvent> events;
  double now = 100;
};

inline std::multiset<std::string> active_in_file(double seconds) {
  auto reader = SceneReader::open(memory_source(clip().bytes));
  REQUIRE(reader.ok());
  return active_fingerprints(*Timeline::from_reader(std::move(*reader)), seconds);
}

}  // namespace stgs::player
