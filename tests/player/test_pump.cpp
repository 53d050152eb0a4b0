// SPDX-License-Identifier: Apache-2.0
// A player without threads: the test delivers the bytes and drives pump() on one thread.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <set>
#include <utility>

#include "catch.h"
#include "live_fixture.h"
#include "renderer_memory.h"
#include "stream/snapshot_source.h"
#include "stream/stream_player.h"
#include "stream/tier_peaks.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Reads that wait until the test delivers them.
class ManualSource final : public AsyncByteSource {
 public:
  struct Read {
    std::uint64_t id = 0, offset = 0;
    std::span<std::uint8_t> out;
    bool cancelled = false;
  };
  explicit ManualSource(const Bytes& bytes) : bytes_(bytes) {}
  void start(Completion completion) override { completion_ = std::move(completion); }
  void begin_read(std::uint64_t id, std::uint64_t offset,
                  std::span<std::uint8_t> out) noexcept override {
    waiting.push_back({id, offset, out});
    offsets.push_back(offset);
  }
  void cancel(std::uint64_t id) noexcept override {
    for (Read& read : waiting) read.cancelled |= read.id == id;
  }
  void stop() noexcept override { stopped = true; }

  // Ends the read that has waited longest.
  void deliver(Status status = {}) {
    if (waiting.empty()) return;
    const Read read = waiting.front();
    waiting.erase(waiting.begin());
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(read.offset), read.out.size(),
                read.out.begin());
    if (read.cancelled) status = runtime_error("cancelled");
    completion_({read.id, std::move(status), true, 0});
  }

  std::vector<Read> waiting;
  std::vector<std::uint64_t> offsets;  // of all reads so far
  bool stopped = false;

 private:
  const Bytes& bytes_;
  Completion completion_;
};

// A recording that grows, each of whose reads and polls fails until its bytes have arrived.
class ArrivingSource final : public ByteSource {
 public:
  explicit ArrivingSource(std::shared_ptr<live::Growth> file) : under_(std::move(file)) {}
  std::uint64_t size() const override { return under_.size(); }
  const std::string& name() const override { return under_.name(); }
  bool may_grow() const override { return true; }
  bool is_pending() const override { return pending_; }
  Result<Change> refresh(std::uint64_t stable_bytes) override {
    STGS_TRY(wait_for({0, 0}));
    arrived_.clear();
    return under_.refresh(stable_bytes);
  }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(wait_for({offset, out.size()}));
    return under_.read(offset, out);
  }
  // Provides the bytes that the last read needed.
  void arrive() { pending_ = false; }

 private:
  Status wait_for(std::pair<std::uint64_t, std::uint64_t> range) const {
    if (!arrived_.insert(range).second) return {};
    pending_ = true;
    return io_error("the bytes have not arrived");
  }

  live::GrowingSource under_;
  mutable std::set<std::pair<std::uint64_t, std::uint64_t>> arrived_;
  mutable bool pending_ = false;
};

// A player of `bytes` whose reader cannot read any segment itself.
struct Pumped {
  explicit Pumped(const Bytes& bytes = clip().bytes, PlayerSettings settings = {}) {
    auto link = std::make_shared<Link>();
    auto* const memory = std::pmr::get_default_resource();
    budget = make_budget(settings.memory_budget);
    auto ranges =
        std::make_shared<RangeSource>(std::make_unique<LinkSource>(bytes, link), memory, budget);
    IndexCache cache(budget);
    auto reader = open_snapshot(ranges, cache, settings.limits, memory, IndexLoading::kComplete);
    REQUIRE(reader.ok());
    link->set(Link::Answer::kFail);
    auto manual = std::make_unique<ManualSource>(bytes);
    source = manual.get();
    player = std::make_unique<StreamPlayer>(
        OpenedFile{*reader, ranges, std::move(cache)}, settings, budget, std::move(manual),
        std::make_unique<InlineExecutor>(SegmentDecoder("clip", nullptr), nullptr));
  }
  // Delivers at most one read, makes one step, and shows a frame.
  PumpResult frame(double passed = 0) {
    source->deliver();
    const PumpResult result = player->pump(now, 0);
    player->advance(now += passed);
    for (PlayerEvent& event : player->take_events()) events.push_back(std::move(event));
    return result;
  }
  bool complete() {
    for (int k = 0; k < 1000; ++k) {
      frame();
      if (player->layers() == player->layer_count()) return true;
    }
    return false;
  }
  int count(Kind kind) const {
    return static_cast<int>(std::count_if(events.begin(), events.end(),
                                          [&](const PlayerEvent& e) { return e.kind == kind; }));
  }

  std::shared_ptr<Budget> budget;
  ManualSource* source = nullptr;
  std::unique_ptr<StreamPlayer> player;
  std::vector<PlayerEvent> events;
  double now = 100;
};

// Threads of this process.
std::ptrdiff_t count_threads() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {});
}

void check_complete_playback(const Bytes& bytes, double seconds) {
  auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  const auto file = Timeline::from_reader(std::move(*reader));
  (void)active_fingerprints(*file, 0);  // starts the thread pool
  const std::ptrdiff_t threads = count_threads();
  Pumped p(bytes);
  p.player->play();
  int frames = 0, complete = 0;
  for (; frames < 5000 && p.player->state() != PlayerState::kEnded; ++frames) {
    p.frame(1.0 / 30);
    if (p.player->layers() < p.player->layer_count()) continue;
    ++complete;
    const double at = p.player->seconds();
    if (frames % 10 == 0)
      CHECK(active_fingerprints(p.player->timeline(), at) == active_fingerprints(*file, at));
  }
  CHECK(p.player->state() == PlayerState::kEnded);
  CHECK(p.player->seconds() == Approx(seconds - 1.0 / 30));
  CHECK(p.count(Kind::kEnded) == 1);
  CHECK(p.count(Kind::kReadFailed) == 0);
  CHECK(complete > 10);
  CHECK(count_threads() == threads);
}

TEST_CASE("a clip and a closed recording play to their end on one thread") {
  SECTION("clip") {
    check_complete_playback(clip().bytes, 3);
  }
  SECTION("recording") {
    check_complete_playback(live::recording().bytes, live::kFragments * live::kFragmentSeconds);
  }
}

TEST_CASE("two runs without threads make the same reads and report the same events") {
  const auto run = [] {
    PlayerSettings settings;
    settings.memory_budget = 600'000;
    Pumped p(clip().bytes, settings);
    p.player->play();
    for (int k = 0; k < 60; ++k) p.frame(1.0 / 30);
    REQUIRE(p.player->seek(2.5).ok());
    for (int k = 0; k < 60; ++k) p.frame(1.0 / 30);
    std::vector<std::pair<Kind, double>> events;
    for (const PlayerEvent& event : p.events) events.emplace_back(event.kind, event.seconds);
    return std::pair(p.source->offsets, events);
  };
  const auto first = run();
  CHECK(first.first.size() > 5);
  CHECK(first == run());
}

TEST_CASE("pump() returns at once, and states when to call it again") {
  PlayerSettings settings;
  settings.max_reads_in_flight = 2;
  settings.retry_seconds = 2;
  Pumped p(clip().bytes, settings);
  CHECK(p.player->pump(p.now, 0).progressed);  // begins reads
  const std::size_t begun = p.source->waiting.size();
  CHECK(begun >= 1);
  CHECK(begun <= 2);
  PumpResult idle = p.player->pump(p.now, 0);
  CHECK_FALSE(idle.progressed);
  CHECK(p.source->waiting.size() == begun);
  // Everything but the first read, which fails.
  const std::uint64_t failed = p.source->waiting.front().offset;
  p.source->deliver(io_error("the link is down"));
  for (int k = 0; k < 500; ++k) {
    idle = p.player->pump(p.now, 0);
    if (!idle.progressed && p.source->waiting.empty()) break;
    p.source->deliver();
  }
  CHECK(idle.wake_at == p.now + 2);
  CHECK_FALSE(p.player->pump(p.now + 1.9, 0).progressed);
  CHECK(p.player->pump(p.now + 2, 0).progressed);
  REQUIRE(p.source->waiting.size() >= 1);
  CHECK(p.source->waiting.front().offset == failed);
}

TEST_CASE("one call of pump() with a time budget decodes all that has arrived") {
  Pumped p;
  while (p.player->pump(p.now, 0).progressed) continue;
  p.source->deliver();
  CHECK_FALSE(p.player->pump(p.now, 1000).progressed);
  CHECK(p.player->statistics().stored_primitives > 0);
}

TEST_CASE("a seek cancels a read that nobody waits for, after half a second") {
  PlayerSettings settings;
  settings.prefetch_seconds = 0.1;
  Pumped p(clip().bytes, settings);
  const SegmentInfo* early = nullptr;  // of the beginning alone
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.tier == 0 && s.level >= 0 && s.end_ticks <= 20) early = &s;
  }
  REQUIRE(early != nullptr);
  REQUIRE(p.player->seek_frame(static_cast<std::uint32_t>(early->begin_ticks)).ok());
  const auto is_early = [&](const ManualSource::Read& read) {
    return early->offset <= read.offset && read.offset < early->offset + early->bytes;
  };
  const auto waits = [&] {
    auto& waiting = p.source->waiting;
    return std::find_if(waiting.begin(), waiting.end(), is_early);
  };
  for (int k = 0; k < 100 && waits() == p.source->waiting.end(); ++k) {
    while (p.player->pump(p.now, 0).progressed) continue;
    if (waits() == p.source->waiting.end()) p.source->deliver();
  }
  REQUIRE(waits() != p.source->waiting.end());
  REQUIRE(p.player->seek_frame(80).ok());
  p.player->pump(p.now + 0.4, 0);
  CHECK_FALSE(waits()->cancelled);
  p.player->pump(p.now + 0.5, 0);
  CHECK(waits()->cancelled);
  REQUIRE(p.complete());
  CHECK(p.count(Kind::kReadFailed) == 0);
}

TEST_CASE("the peaks of the tiers are those of all times") {
  const SceneReader& reader = *clip().reader;
  std::vector<std::uint64_t> expected(2);
  for (const SegmentInfo& one : reader.segments()) {
    for (int tiers = 1; tiers <= 2; ++tiers) {
      std::uint64_t active = 0;
      for (const std::uint32_t s : reader.segments_between(one.begin_ticks, one.begin_ticks)) {
        const SegmentInfo& segment = reader.segments()[s];
        if (segment.tier < tiers) active += segment.primitives;
      }
      auto& peak = expected[static_cast<std::size_t>(tiers - 1)];
      peak = std::max(peak, active);
    }
  }
  CHECK(expected[0] < expected[1]);
  CHECK(tier_peaks(reader.segments(), 2) == expected);
}

TEST_CASE("a limit of primitives removes tiers at once, and others are fetched when it is raised") {
  Pumped p;
  const auto greatest_tier = [&] {
    const auto visible = p.player->timeline().visible_segments(p.player->seconds());
    REQUIRE(visible.ok());
    int tier = -1;
    for (const Timeline::SegmentRef& ref : *visible)
      tier = std::max<int>(tier, clip().reader->segments()[ref.segment].tier);
    return tier;
  };
  SECTION("before anything is fetched") {}
  SECTION("while segments are in flight") {
    for (int k = 0; k < 5; ++k) p.frame();
  }
  SECTION("when everything is resident") {
    REQUIRE(p.complete());
    CHECK(greatest_tier() == 1);
  }
  p.player->limit_primitives(0);
  const std::vector<std::uint64_t> peaks = p.player->tier_peaks();
  REQUIRE(peaks.size() == 2);
  CHECK(greatest_tier() <= 0);
  for (int k = 0; k < 200; ++k) p.frame();
  CHECK(greatest_tier() == 0);
  CHECK(p.player->layers() == 1);
  CHECK(p.player->is_complete());
  p.player->limit_primitives(peaks[1] - 1);
  for (int k = 0; k < 200; ++k) p.frame();
  CHECK(greatest_tier() == 0);
  p.player->limit_primitives(peaks[1]);
  REQUIRE(p.complete());
  CHECK(greatest_tier() == 1);
  CHECK(p.count(Kind::kReadFailed) == 0);
}

TEST_CASE("all memory of a player is charged, and released with it") {
  Pumped p;
  const std::shared_ptr<Budget> budget = p.budget;
  const auto used = [&](Budget::Pool pool) { return budget->usage(pool).used; };
  while (p.player->pump(p.now, 0).progressed) continue;
  std::uint64_t reading = 0;
  for (const ManualSource::Read& read : p.source->waiting) reading += read.out.size();
  CHECK(used(Budget::Pool::kTransfers) >= reading);
  REQUIRE(p.complete());
  CHECK(used(Budget::Pool::kSegments) == p.player->statistics().memory_bytes);
  CHECK(budget->usage(Budget::Pool::kSegments).limit == kDefaultMemoryBudget);
  CHECK(budget->usage(Budget::Pool::kDecodeScratch).peak > 0);
  CHECK(budget->usage(Budget::Pool::kIndex).peak > 0);
  p.player.reset();  // while reads are in flight
  for (std::size_t k = 0; k < static_cast<std::size_t>(Budget::Pool::kCount); ++k) {
    CHECK(used(static_cast<Budget::Pool>(k)) == 0);
  }
}

TEST_CASE("a recording is followed by reads that do not wait") {
  PlayerSettings settings = live::quick();
  const auto file = std::make_shared<live::Growth>();
  file->grow(live::recording().ends[3]);
  auto arriving = std::make_unique<ArrivingSource>(file);
  ArrivingSource* const source = arriving.get();
  const auto budget = make_budget(settings.memory_budget);
  const auto ranges =
      std::make_shared<RangeSource>(std::move(arriving), std::pmr::get_default_resource(), budget);
  IndexCache cache(budget);
  const auto open = [&] {
    source->arrive();
    return open_snapshot(ranges, cache, settings.limits, std::pmr::get_default_resource(),
                         IndexLoading::kOnDemand);
  };
  auto reader = open();
  for (int k = 0; k < 100 && source->is_pending(); ++k) reader = open();
  REQUIRE(reader.ok());
  auto manual = std::make_unique<ManualSource>(live::recording().bytes);
  ManualSource* const transport = manual.get();
  StreamPlayer player(
      {*reader, ranges, std::move(cache)}, settings, budget, std::move(manual),
      std::make_unique<InlineExecutor>(SegmentDecoder("recording", nullptr), nullptr));
  CHECK(player.live().following);
  player.play();
  double now = 100;
  std::uint32_t fragments = 3;
  std::vector<Kind> events;
  for (int k = 0; k < 5000 && player.state() != PlayerState::kEnded; ++k) {
    transport->deliver();
    if (!player.pump(now, 0).progressed) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (k % 3 == 0) source->arrive();
    player.advance(now);
    for (const PlayerEvent& event : player.take_events()) events.push_back(event.kind);
    const LiveState state = player.live();
    if (state.growing && fragments <= live::kFragments &&
        state.edge_seconds < fragments * live::kFragmentSeconds - 1e-6) {
      continue;
    }
    now += live::kFragmentSeconds / 4;
    if (++fragments <= live::kFragments)
      file->grow(live::recording().ends[fragments]);
    else
      file->grow(live::recording().closed());
  }
  CHECK(player.state() == PlayerState::kEnded);
  CHECK(player.snapshot().reader->form() == SceneForm::kRecorded);
  CHECK(std::count(events.begin(), events.end(), Kind::kFinished) == 1);
  CHECK(std::count(events.begin(), events.end(), Kind::kReadFailed) == 0);
}

}  // namespace
}  // namespace stgs::player
