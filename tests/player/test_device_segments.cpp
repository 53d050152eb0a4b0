// SPDX-License-Identifier: Apache-2.0
// Which segments a backend uploads and evicts, with a device that only counts.
#include <algorithm>
#include <chrono>
#include <map>
#include <set>

#include "catch.h"
#include "device_segments.h"
#include "fixtures/scene_fixture.h"

namespace stgs::player {
namespace {

constexpr std::uint64_t kPrimitiveBytes = 100;  // on the device

std::unique_ptr<Timeline> make_timeline(std::uint64_t budget = kDefaultMemoryBudget,
                                        WriteSettings settings = {}) {
  settings.chunk_seconds = 0.2;
  auto bytes = encode_scene(testing::random_scene(2000, 1, 90, 5), settings);
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  REQUIRE(reader.ok());
  return Timeline::from_reader(std::move(*reader), "the scene", budget);
}

class WrappedTimeline : public Timeline {
 public:
  explicit WrappedTimeline(std::unique_ptr<Timeline> wrapped) : wrapped_(std::move(wrapped)) {}
  const std::string& name() const override { return wrapped_->name(); }
  const SceneMetadata& metadata() const override { return wrapped_->metadata(); }
  double duration_seconds() const override { return wrapped_->duration_seconds(); }
  const std::vector<Issue>& damage() const override { return wrapped_->damage(); }
  double complete_seconds() const override { return wrapped_->complete_seconds(); }
  const std::vector<SegmentDamage>& segment_damage() const override {
    return wrapped_->segment_damage();
  }
  Result<Active> at(double seconds) override { return wrapped_->at(seconds); }
  std::uint64_t version = 0;  // of the first segment
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> refs, wrapped_->visible_segments(seconds));
    refs.front().version = version;
    return refs;
  }
  const SceneReader& reader() const override { return wrapped_->reader(); }
  Result<std::optional<Gaussians4D>> decode(std::uint32_t s) override {
    return wrapped_->decode(s);
  }
  std::uint64_t memory_budget() const override { return wrapped_->memory_budget(); }
  const std::shared_ptr<Budget>& budget() const override { return wrapped_->budget(); }
  const std::shared_ptr<const void>& identity() const override { return wrapped_->identity(); }
  std::uint64_t memory_bytes() const override { return wrapped_->memory_bytes(); }
  std::uint64_t stored_primitives() const override { return wrapped_->stored_primitives(); }

 private:
  std::unique_ptr<Timeline> wrapped_;
};

// A stream whose last segment arrives after the first call.
class ArrivingTimeline final : public WrappedTimeline {
 public:
  ArrivingTimeline() : WrappedTimeline(make_timeline()) {}
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> needed, WrappedTimeline::visible_segments(seconds));
    if (calls_++ == 0) needed.pop_back();
    return needed;
  }

 private:
  int calls_ = 0;
};

// A player's timeline: all segments are decoded, and take several uploads each.
class DecodedTimeline final : public WrappedTimeline {
 public:
  explicit DecodedTimeline(std::uint64_t budget = kDefaultMemoryBudget)
      : WrappedTimeline(make_timeline(budget, in_tiers())) {
    large_->resize(4 * 65536 + 100);
    small_->resize(10);
  }
  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> needed, WrappedTimeline::visible_segments(seconds));
    for (SegmentRef& one : needed) {
      one.set = refined.contains(one.segment) ? refined.at(one.segment) : of_tier(one.segment);
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
  std::map<std::uint32_t, std::shared_ptr<const Gaussians4D>> refined;
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
  std::set<std::uint32_t> resident;
  std::map<std::uint32_t, std::size_t> arriving;  // next primitive of each upload in progress
  int uploaded = 0, uploads = 0;
  std::uint64_t reserved = 0;
  std::chrono::milliseconds upload_takes{0};

 private:
  Status begin(const SceneReader& /*reader*/) override { return {}; }
  void reserve(std::uint64_t bytes) override { reserved = bytes; }
  std::uint64_t bytes_of(std::uint64_t primitives) const override {
    return kPrimitiveBytes * primitives;
  }
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override {
    for (const std::uint32_t s : segments) STGS_TRY(decode_on_cpu(timeline, s));
    return {};
  }
  Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) override {
    if (first == 0) arriving.erase(segment);
    CHECK(arriving[segment] == first);
    time_ += upload_takes;
    ++uploads;
    arriving[segment] += kMaxUploadPrimitives;
    if (arriving[segment] < set.size()) return {};
    arriving.erase(segment);
    resident.insert(segment);
    ++uploaded;
    insert(segment, set.size(), kPrimitiveBytes * set.size(), set.time_origin);
    return {};
  }
  void cancel_upload(std::uint32_t segment) override { CHECK(arriving.erase(segment) == 1); }
  void release(std::uint32_t segment) override { CHECK(resident.erase(segment) == 1); }
  Clock::time_point now() const override { return time_; }

  Clock::time_point time_{std::chrono::hours(1)};  // advances by uploads only
};

TEST_CASE("the segments of a time are uploaded once") {
  const auto timeline = make_timeline();
  CountingDevice device;
  const auto needed = device.make_resident(*timeline, 1.0);
  REQUIRE(needed.ok());
  CHECK(needed->size() == timeline->visible_segments(1.0)->size());
  const int uploaded = device.uploaded;
  CHECK(uploaded == static_cast<int>(needed->size()));
  REQUIRE(device.make_resident(*timeline, 1.0).ok());
  CHECK(device.uploaded == uploaded);
  const auto other = make_timeline();
  REQUIRE(device.make_resident(*other, 1.0).ok());
  CHECK(device.uploaded == 2 * uploaded);
  CHECK(device.resident.size() == needed->size());
}

TEST_CASE("a segment is uploaded again if it has ended primitives") {
  WrappedTimeline timeline(make_timeline());
  CountingDevice device;
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  const int uploaded = device.uploaded;
  timeline.version = 1;
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  CHECK(device.uploaded == uploaded + 1);
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  CHECK(device.uploaded == uploaded + 1);
}

TEST_CASE("a segment that arrives during an upload belongs to the next frame") {
  ArrivingTimeline timeline;
  CountingDevice device;
  const auto first = device.make_resident(timeline, 1.0);
  REQUIRE(first.ok());
  for (const auto& one : *first) CHECK(device.resident.contains(one.segment));
  const auto second = device.make_resident(timeline, 1.0);
  REQUIRE(second.ok());
  CHECK(second->size() == first->size() + 1);
}

std::size_t all_of(Timeline& timeline, double seconds) {
  const auto needed = timeline.visible_segments(seconds);
  REQUIRE(needed.ok());
  return needed->size();
}

TEST_CASE("during playback, refinements are uploaded over several frames") {
  DecodedTimeline timeline;
  CountingDevice device;
  device.upload_takes = std::chrono::milliseconds(8);
  const std::size_t all = all_of(timeline, 1.0);
  auto rendered = device.make_resident(timeline, 1.0);
  REQUIRE(rendered.ok());
  CHECK(rendered->size() < all);
  const auto count_first = [&](const std::vector<Timeline::SegmentRef>& some) {
    return std::count_if(some.begin(), some.end(),
                         [&](const auto& one) { return timeline.is_first(one.segment); });
  };
  const auto needed = timeline.visible_segments(1.0);
  REQUIRE(needed.ok());
  REQUIRE(count_first(*needed) > 0);
  CHECK(count_first(*rendered) == count_first(*needed));
  while (rendered->size() < all) {
    const int before = device.uploads;
    rendered = device.make_resident(timeline, 1.0);
    REQUIRE(rendered.ok());
    REQUIRE(device.uploads > before);
    REQUIRE(device.uploads <= before + 4);
  }
  CHECK(device.uploaded == static_cast<int>(all));
  CHECK(device.arriving.empty());

  SECTION("a segment is rendered until its refinement is uploaded") {
    const std::uint32_t changed = rendered->front().segment;
    REQUIRE(timeline.is_first(changed));
    const auto refined = std::make_shared<Gaussians4D>();
    refined->resize(5 * CountingDevice::kMaxUploadPrimitives);
    timeline.refined[changed] = refined;
    int frames = 0;
    for (; device.uploaded == static_cast<int>(all); ++frames) {
      rendered = device.make_resident(timeline, 1.0);
      REQUIRE(rendered.ok());
      REQUIRE(rendered->size() == all);
      REQUIRE(device.resident.contains(changed));
    }
    CHECK(frames > 1);
    const int uploads = device.uploads;
    REQUIRE(device.make_resident(timeline, 1.0).ok());
    CHECK(device.uploads == uploads);
  }
}

// Returns the segments of another time that are not needed at `seconds`.
std::vector<Timeline::SegmentRef> only_at(DecodedTimeline& timeline, double other, double seconds) {
  auto others = timeline.visible_segments(other);
  const auto here = timeline.visible_segments(seconds);
  REQUIRE(others.ok());
  REQUIRE(here.ok());
  std::erase_if(*others, [&](const auto& one) {
    return std::any_of(here->begin(), here->end(),
                       [&](const auto& now) { return now.segment == one.segment; });
  });
  REQUIRE_FALSE(others->empty());
  return std::move(*others);
}

TEST_CASE("during playback, segments needed soon are uploaded in advance and not rendered") {
  DecodedTimeline timeline;
  CountingDevice device;
  timeline.soon = only_at(timeline, 2.0, 1.0);
  const std::size_t all = all_of(timeline, 1.0);
  const auto is_resident = [&](const auto& one) { return device.resident.contains(one.segment); };
  for (int k = 0; k < 1000; ++k) {
    const auto rendered = device.make_resident(timeline, 1.0);
    REQUIRE(rendered.ok());
    REQUIRE(rendered->size() <= all);
    if (std::all_of(timeline.soon.begin(), timeline.soon.end(), is_resident)) break;
  }
  CHECK(std::all_of(timeline.soon.begin(), timeline.soon.end(), is_resident));
  const int uploaded = device.uploaded;
  timeline.soon.clear();
  REQUIRE(device.make_resident(timeline, 2.0).ok());
  CHECK(device.uploaded == uploaded);
}

std::uint64_t bytes_at(DecodedTimeline& timeline, double seconds) {
  const auto needed = timeline.visible_segments(seconds);
  REQUIRE(needed.ok());
  std::uint64_t bytes = 0;
  for (const auto& one : *needed) {
    bytes += kPrimitiveBytes * timeline.reader().segments()[one.segment].primitives;
  }
  return bytes;
}

TEST_CASE("with little memory, segments that are not needed are evicted before those that are") {
  DecodedTimeline unlimited;
  const double fuller = bytes_at(unlimited, 1.0) > bytes_at(unlimited, 2.0) ? 1.0 : 2.0;
  const double other = 3.0 - fuller;
  const auto rendered = unlimited.visible_segments(fuller);
  REQUIRE(rendered.ok());
  REQUIRE(rendered->size() > 2);
  const std::uint32_t changed[] = {rendered->front().segment, rendered->back().segment};
  std::uint64_t more = 0;
  for (const std::uint32_t s : changed)
    more += kPrimitiveBytes * unlimited.reader().segments()[s].primitives;
  // The rendered segments, and the two that change.
  DecodedTimeline timeline(bytes_at(unlimited, fuller) + more);
  timeline.as_in_file = true;
  timeline.playing = false;
  CountingDevice device;
  REQUIRE(device.make_resident(timeline, other).ok());
  REQUIRE(device.make_resident(timeline, fuller).ok());
  REQUIRE(device.resident.size() > rendered->size());
  timeline.playing = true;
  const auto check_rendered = [&] {
    for (const auto& one : *rendered) CHECK(device.resident.contains(one.segment));
    const Budget::Usage usage = timeline.budget()->usage(Budget::Pool::kDeviceCopies);
    CHECK(kPrimitiveBytes * device.stored_primitives() <= usage.used);
    CHECK(usage.peak <= timeline.memory_budget());
  };

  SECTION("a changed segment stays until its refinement is uploaded") {
    if (GENERATE(false, true)) timeline.soon = only_at(timeline, other, fuller);
    device.upload_takes = std::chrono::milliseconds(26);
    for (const std::uint32_t s : changed) {
      timeline.refined[s] = std::make_shared<Gaussians4D>(*timeline.of_tier(s));
    }
    const int uploaded = device.uploaded;
    for (int k = 1; k <= 2; ++k) {
      REQUIRE(device.make_resident(timeline, fuller).ok());
      CHECK(device.uploaded == uploaded + k);
      check_rendered();
    }
  }
  SECTION("segments needed soon do not displace rendered ones") {
    timeline.soon = only_at(timeline, other, fuller);
    for (int k = 0; k < 20; ++k) {
      REQUIRE(device.make_resident(timeline, fuller).ok());
      check_rendered();
    }
  }
}

TEST_CASE("while paused, all segments are uploaded at once") {
  DecodedTimeline timeline;
  timeline.playing = false;
  CountingDevice device;
  device.upload_takes = std::chrono::milliseconds(3);
  const auto rendered = device.make_resident(timeline, 1.0);
  REQUIRE(rendered.ok());
  CHECK(rendered->size() == all_of(timeline, 1.0));
}

TEST_CASE("an upload that is too slow is cancelled") {
  DecodedTimeline timeline;
  CountingDevice device;
  device.upload_takes = std::chrono::milliseconds(26);  // more than a frame waits
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  REQUIRE(device.arriving.size() == 1);
  const std::uint32_t late = device.arriving.begin()->first;
  timeline.refined[late] = std::make_shared<Gaussians4D>(*timeline.of_tier(late));
  timeline.playing = false;
  REQUIRE(device.make_resident(timeline, 1.0).ok());
  CHECK(device.arriving.empty());
  CHECK(device.resident.contains(late));
}

TEST_CASE("a device stays within the budget and evicts the least recently needed segments") {
  const auto unlimited = make_timeline();
  std::uint64_t peak = 0;
  for (double t = 0; t < 3; t += 0.1) {
    std::uint64_t bytes = 0;
    const auto needed = unlimited->visible_segments(t);
    REQUIRE(needed.ok());
    for (const auto& one : *needed) {
      bytes += kPrimitiveBytes * unlimited->reader().segments()[one.segment].primitives;
    }
    peak = std::max(peak, bytes);
  }
  const auto timeline = make_timeline(peak);
  CountingDevice device;
  for (double t = 0; t < 3; t += 0.1) {
    REQUIRE(device.make_resident(*timeline, t).ok());
    CHECK(kPrimitiveBytes * device.stored_primitives() <= peak);
  }
  CHECK(device.reserved == peak);
  CHECK(kPrimitiveBytes * device.peak().primitives == peak);
  const auto little = make_timeline(peak / 4);
  const auto refused = device.make_resident(*little, 1.5);
  REQUIRE_FALSE(refused.ok());
  CHECK(refused.status().message().find("MiB decoded, more than the budget") != std::string::npos);
}

}  // namespace
}  // namespace stgs::player
