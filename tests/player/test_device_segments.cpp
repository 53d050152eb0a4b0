// SPDX-License-Identifier: Apache-2.0
// What a backend's device is asked to hold, with a device that only counts.
#include <algorithm>
#include <chrono>
#include <map>
#include <set>

#include "catch.h"
#include "device_segments.h"
#include "fixtures/scene_fixture.h"

namespace stgs::player {
namespace {

constexpr std::uint64_t kEach = 100;  // bytes of a primitive on the device

std::unique_ptr<Timeline> make_timeline(std::uint64_t budget = kDefaultMemoryBudget,
                                        WriteSettings settings = {}) {
  settings.chunk_seconds = 0.2;
  auto bytes = encode_scene(testing::random_scene(2000, 1, 90, 5), settings);
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  REQUIRE(reader.ok());
  return Timeline::from_reader(std::move(*reader), "the scene", budget);
}

class OverTimeline : public Timeline {
 public:
  explicit OverTimeline(std::unique_ptr<Timeline> under) : under_(std::move(under)) {}
  const std::string& name() const override { return under_->name(); }
  const SceneMetadata& metadata() const override { return under_->metadata(); }
  double duration_seconds() const override { return under_->duration_seconds(); }
  const std::vector<Issue>& damage() const override { return under_->damage(); }
  double complete_seconds() const override { return under_->complete_seconds(); }
  const std::vector<SegmentDamage>& segment_damage() const override {
    return under_->segment_damage();
  }
  Result<Active> at(double seconds) override { return under_->at(seconds); }
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    return under_->visible_segments(seconds);
  }
  const SceneReader& reader() const override { return under_->reader(); }
  Result<std::optional<Gaussians4D>> decode(std::uint32_t s) override { return under_->decode(s); }
  std::uint64_t memory_budget() const override { return under_->memory_budget(); }
  const std::shared_ptr<const void>& identity() const override { return under_->identity(); }
  std::uint64_t memory_bytes() const override { return under_->memory_bytes(); }
  std::uint64_t stored_primitives() const override { return under_->stored_primitives(); }

 private:
  std::unique_ptr<Timeline> under_;
};

// A stream of which more comes between two questions: the first call lacks the last segment.
class Coming final : public OverTimeline {
 public:
  Coming() : OverTimeline(make_timeline()) {}
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> needed, OverTimeline::visible_segments(seconds));
    if (calls_++ == 0) needed.pop_back();
    return needed;
  }

 private:
  int calls_ = 0;
};

// A player's: what it needs is decoded, and each segment a few pieces long.
class Decoded final : public OverTimeline {
 public:
  explicit Decoded(std::uint64_t budget = kDefaultMemoryBudget)
      : OverTimeline(make_timeline(budget, in_tiers())) {
    large_->resize(4 * 65536 + 100);
    small_->resize(10);
  }
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> needed, OverTimeline::visible_segments(seconds));
    for (SegmentRef& one : needed) {
      one.set = better.contains(one.segment) ? better.at(one.segment) : of_tier(one.segment);
    }
    return needed;
  }
  bool is_playing() const override { return playing; }
  std::vector<SegmentRef> prefetch_segments(double /*seconds*/) override { return soon; }
  bool is_first(std::uint32_t segment) const { return reader().segments()[segment].tier == 0; }
  std::shared_ptr<const Gaussians4D> of_tier(std::uint32_t segment) {
    if (!as_in_file) return is_first(segment) ? small_ : large_;
    auto& set = in_file_[segment];
    if (set == nullptr) {
      set = std::make_shared<Gaussians4D>();
      set->resize(reader().segments()[segment].primitives);
    }
    return set;
  }

  bool playing = true, as_in_file = false;
  std::map<std::uint32_t, std::shared_ptr<const Gaussians4D>> better;
  std::vector<SegmentRef> soon;

 private:
  static WriteSettings in_tiers() {
    WriteSettings settings;
    settings.profile = Profile::kQuantised;
    settings.tiers = 3;
    return settings;
  }
  std::map<std::uint32_t, std::shared_ptr<Gaussians4D>> in_file_;
  std::shared_ptr<Gaussians4D> large_ = std::make_shared<Gaussians4D>();
  std::shared_ptr<Gaussians4D> small_ = std::make_shared<Gaussians4D>();
};

class CountingDevice final : public DeviceSegments {
 public:
  ~CountingDevice() override { clear(); }

  static constexpr std::size_t kMaxUploadPrimitives = DeviceSegments::kMaxUploadPrimitives;
  std::set<std::uint32_t> there;
  std::map<std::uint32_t, std::size_t> arriving;  // what comes next of each
  int sent = 0, pieces = 0;
  std::uint64_t reserved = 0;
  std::chrono::milliseconds piece_takes{0};

 private:
  Status begin(const SceneReader& /*reader*/) override { return {}; }
  void reserve(std::uint64_t bytes) override { reserved = bytes; }
  std::uint64_t bytes_of(std::uint64_t primitives) const override { return kEach * primitives; }
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override {
    for (const std::uint32_t s : segments) STGS_TRY(decode_on_cpu(timeline, s));
    return {};
  }
  Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) override {
    if (first == 0) arriving.erase(segment);
    CHECK(arriving[segment] == first);
    time_ += piece_takes;
    ++pieces;
    arriving[segment] += kMaxUploadPrimitives;
    if (arriving[segment] < set.size()) return {};
    arriving.erase(segment);
    there.insert(segment);
    ++sent;
    insert(segment, set.size(), kEach * set.size());
    return {};
  }
  void cancel_upload(std::uint32_t segment) override { CHECK(arriving.erase(segment) == 1); }
  void release(std::uint32_t segment) override { CHECK(there.erase(segment) == 1); }
  Clock::time_point now() const override { return time_; }

  Clock::time_point time_{std::chrono::hours(1)};  // nothing but pieces takes any
};

TEST_CASE("a device holds what a moment needs, and is sent it once") {
  const auto timeline = make_timeline();
  CountingDevice device;
  const auto needed = device.make_resident(*timeline, 1.0);
  REQUIRE(needed.ok());
  CHECK(needed->size() == timeline->visible_segments(1.0)->size());
  const int sent = device.sent;
  CHECK(sent == static_cast<int>(needed->size()));
  REQUIRE(device.make_resident(*timeline, 1.0).ok());
  CHECK(device.sent == sent);
  const auto other = make_timeline();
  REQUIRE(device.make_resident(*other, 1.0).ok());
  CHECK(device.sent == 2 * sent);
  CHECK(device.there.size() == needed->size());
}

TEST_CASE("what comes while a moment is brought is for the next picture") {
  Coming timeline;
  CountingDevice device;
  const auto first = device.make_resident(timeline, 1.0);
  REQUIRE(first.ok());
  for (const auto& one : *first) CHECK(device.there.contains(one.segment));
  const auto second = device.make_resident(timeline, 1.0);
  REQUIRE(second.ok());
  CHECK(second->size() == first->size() + 1);
}

std::size_t all_of(Timeline& timeline, double seconds) {
  const auto needed = timeline.visible_segments(seconds);
  REQUIRE(needed.ok());
  return needed->size();
}

TEST_CASE("while it plays, what makes a picture better comes with several pictures") {
  Decoded timeline;
  CountingDevice device;
  device.piece_takes = std::chrono::milliseconds(8);
  const std::size_t all = all_of(timeline, 1.0);
  auto drawn = device.make_resident(timeline, 1.0);
  REQUIRE(drawn.ok());
  CHECK(drawn->size() < all);
  const auto count_first = [&](const std::vector<Timeline::SegmentRef>& some) {
    return std::count_if(some.begin(), some.end(),
                         [&](const auto& one) { return timeline.is_first(one.segment); });
  };
  const auto needed = timeline.visible_segments(1.0);
  REQUIRE(needed.ok());
  REQUIRE(count_first(*needed) > 0);
  CHECK(count_first(*drawn) == count_first(*needed));
  while (drawn->size() < all) {
    const int before = device.pieces;
    drawn = device.make_resident(timeline, 1.0);
    REQUIRE(drawn.ok());
    REQUIRE(device.pieces > before);
    REQUIRE(device.pieces <= before + 4);
  }
  CHECK(device.sent == static_cast<int>(all));
  CHECK(device.arriving.empty());

  SECTION("and what there was of a segment is drawn until a better one is there") {
    const std::uint32_t changed = drawn->front().segment;
    REQUIRE(timeline.is_first(changed));
    const auto better = std::make_shared<Gaussians4D>();
    better->resize(5 * CountingDevice::kMaxUploadPrimitives);
    timeline.better[changed] = better;
    int pictures = 0;
    for (; device.sent == static_cast<int>(all); ++pictures) {
      drawn = device.make_resident(timeline, 1.0);
      REQUIRE(drawn.ok());
      REQUIRE(drawn->size() == all);
      REQUIRE(device.there.contains(changed));
    }
    CHECK(pictures > 1);
    const int pieces = device.pieces;
    REQUIRE(device.make_resident(timeline, 1.0).ok());
    CHECK(device.pieces == pieces);
  }
}

// What is needed at another moment and not at `seconds`.
std::vector<Timeline::SegmentRef> only_at(Decoded& timeline, double other, double seconds) {
  auto there = timeline.visible_segments(other);
  const auto here = timeline.visible_segments(seconds);
  REQUIRE(there.ok());
  REQUIRE(here.ok());
  std::erase_if(*there, [&](const auto& one) {
    return std::any_of(here->begin(), here->end(),
                       [&](const auto& now) { return now.segment == one.segment; });
  });
  REQUIRE_FALSE(there->empty());
  return std::move(*there);
}

TEST_CASE("while it plays, what is needed soon is brought ahead and not drawn") {
  Decoded timeline;
  CountingDevice device;
  timeline.soon = only_at(timeline, 2.0, 1.0);
  const std::size_t all = all_of(timeline, 1.0);
  const auto is_there = [&](const auto& one) { return device.there.contains(one.segment); };
  for (int k = 0; k < 1000; ++k) {
    const auto drawn = device.make_resident(timeline, 1.0);
    REQUIRE(drawn.ok());
    REQUIRE(drawn->size() <= all);
    if (std::all_of(timeline.soon.begin(), timeline.soon.end(), is_there)) break;
  }
  CHECK(std::all_of(timeline.soon.begin(), timeline.soon.end(), is_there));
  const int sent = device.sent;
  timeline.soon.clear();
  REQUIRE(device.make_resident(timeline, 2.0).ok());
  CHECK(device.sent == sent);
}

std::uint64_t bytes_at(Decoded& timeline, double seconds) {
  const auto needed = timeline.visible_segments(seconds);
  REQUIRE(needed.ok());
  std::uint64_t bytes = 0;
  for (const auto& one : *needed) {
    bytes += kEach * timeline.reader().segments()[one.segment].primitives;
  }
  return bytes;
}

TEST_CASE("with little memory what is not needed goes before what is drawn or comes next") {
  Decoded whole;
  const double fuller = bytes_at(whole, 1.0) > bytes_at(whole, 2.0) ? 1.0 : 2.0;
  const double other = 3.0 - fuller;
  const auto drawn = whole.visible_segments(fuller);
  REQUIRE(drawn.ok());
  REQUIRE(drawn->size() > 2);
  const std::uint32_t changed[] = {drawn->front().segment, drawn->back().segment};
  std::uint64_t more = 0;
  for (const std::uint32_t s : changed) more += kEach * whole.reader().segments()[s].primitives;
  // What is drawn, and the two that change.
  Decoded timeline(bytes_at(whole, fuller) + more);
  timeline.as_in_file = true;
  timeline.playing = false;
  CountingDevice device;
  REQUIRE(device.make_resident(timeline, other).ok());
  REQUIRE(device.make_resident(timeline, fuller).ok());
  REQUIRE(device.there.size() > drawn->size());
  timeline.playing = true;
  const auto check_drawn = [&] {
    for (const auto& one : *drawn) CHECK(device.there.contains(one.segment));
    CHECK(kEach * device.stored_primitives() <= timeline.memory_budget());
  };

  SECTION("what has changed stays until a better one is there") {
    if (GENERATE(false, true)) timeline.soon = only_at(timeline, other, fuller);
    device.piece_takes = std::chrono::milliseconds(26);
    for (const std::uint32_t s : changed) {
      timeline.better[s] = std::make_shared<Gaussians4D>(*timeline.of_tier(s));
    }
    const int sent = device.sent;
    for (int k = 1; k <= 2; ++k) {
      REQUIRE(device.make_resident(timeline, fuller).ok());
      CHECK(device.sent == sent + k);
      check_drawn();
    }
  }
  SECTION("what comes next does not displace it") {
    timeline.soon = only_at(timeline, other, fuller);
    for (int k = 0; k < 20; ++k) {
      REQUIRE(device.make_resident(timeline, fuller).ok());
      check_drawn();
    }
  }
}

TEST_CASE("what stands still is all there at once") {
  Decoded timeline;
  timeline.playing = false;
  CountingDevice device;
  device.piece_takes = std::chrono::milliseconds(3);
  const auto drawn = device.make_resident(timeline, 1.0);
  REQUIRE(drawn.ok());
  CHECK(drawn->size() == all_of(timeline, 1.0));
}

TEST_CASE("what has not come in time is given up") {
  Decoded timeline;
  CountingDevice device;
  device.piece_takes = std::chrono::milliseconds(26);  // more than a picture waits
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  REQUIRE(device.arriving.size() == 1);
  const std::uint32_t late = device.arriving.begin()->first;
  timeline.better[late] = std::make_shared<Gaussians4D>(*timeline.of_tier(late));
  timeline.playing = false;
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  CHECK(device.arriving.empty());
  CHECK(device.there.contains(late));
}

TEST_CASE("a device keeps to the budget, and drops what was needed least recently") {
  const auto whole = make_timeline();
  std::uint64_t most = 0;
  for (double t = 0; t < 3; t += 0.1) {
    std::uint64_t bytes = 0;
    const auto needed = whole->visible_segments(t);
    REQUIRE(needed.ok());
    for (const auto& one : *needed) {
      bytes += kEach * whole->reader().segments()[one.segment].primitives;
    }
    most = std::max(most, bytes);
  }
  const auto timeline = make_timeline(most);
  CountingDevice device;
  for (double t = 0; t < 3; t += 0.1) {
    REQUIRE(device.make_resident(*timeline, t).ok());
    CHECK(kEach * device.stored_primitives() <= most);
  }
  CHECK(device.reserved == most);
  CHECK(kEach * device.peak().primitives == most);
  const auto little = make_timeline(most / 4);
  const auto refused = device.make_resident(*little, 1.5);
  REQUIRE_FALSE(refused.ok());
  // In the unit of --memory, rounded to what is enough.
  CHECK(refused.status().message().find("MB (10^6 bytes) decoded, more than the budget") !=
        std::string::npos);
}

}  // namespace
}  // namespace stgs::player
