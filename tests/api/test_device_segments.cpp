// SPDX-License-Identifier: Apache-2.0
// What a backend's device is asked to hold, with a device that only counts.
#include <catch2/catch.hpp>
#include <set>

#include "device_segments.h"
#include "scene_fixture.h"

namespace stgs::player {
namespace {

constexpr std::uint64_t kEach = 100;  // bytes of a primitive on the device

std::unique_ptr<Timeline> make_timeline(std::uint64_t budget = kDefaultMemoryBudget) {
  WriteSettings settings;
  settings.chunk_seconds = 0.2;
  auto bytes = encode_scene(testing::random_scene(2000, 1, 90, 5), settings);
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  REQUIRE(reader.ok());
  return Timeline::over(std::move(*reader), "the scene", budget);
}

// A stream of which more comes between two questions: the first call lacks the last segment.
class Coming final : public Timeline {
 public:
  const std::string& name() const override { return under_->name(); }
  const SceneMetadata& metadata() const override { return under_->metadata(); }
  double duration_seconds() const override { return under_->duration_seconds(); }
  const std::vector<Issue>& damage() const override { return under_->damage(); }
  double complete_seconds() const override { return under_->complete_seconds(); }
  const std::vector<Loss>& losses() const override { return under_->losses(); }
  Result<Active> at(double seconds) override { return under_->at(seconds); }
  Result<std::vector<Needed>> needed_at(double seconds) override {
    STGS_ASSIGN(std::vector<Needed> needed, under_->needed_at(seconds));
    if (calls_++ == 0) needed.pop_back();
    return needed;
  }
  const SceneReader& reader() const override { return under_->reader(); }
  Result<std::optional<Gaussians4D>> decode(std::uint32_t s) override { return under_->decode(s); }
  std::uint64_t memory_budget() const override { return under_->memory_budget(); }
  const std::shared_ptr<const void>& identity() const override { return under_->identity(); }
  std::uint64_t memory_bytes() const override { return under_->memory_bytes(); }
  std::uint64_t stored_primitives() const override { return under_->stored_primitives(); }

 private:
  std::unique_ptr<Timeline> under_ = make_timeline();
  int calls_ = 0;
};

class CountingDevice final : public DeviceSegments {
 public:
  ~CountingDevice() override { clear(); }

  std::set<std::uint32_t> there;
  int sent = 0;

 private:
  Status begin(const SceneReader& /*reader*/) override { return {}; }
  std::uint64_t bytes_of(std::uint64_t primitives) const override { return kEach * primitives; }
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override {
    for (const std::uint32_t s : segments) STGS_TRY(decode_here(timeline, s));
    return {};
  }
  Status send(std::uint32_t segment, const Gaussians4D& set) override {
    CHECK(there.insert(segment).second);
    ++sent;
    keep(segment, set.size(), kEach * set.size());
    return {};
  }
  void release(std::uint32_t segment) override { CHECK(there.erase(segment) == 1); }
};

TEST_CASE("a device holds what a moment needs, and is sent it once") {
  const auto timeline = make_timeline();
  CountingDevice device;
  const auto needed = device.hold(*timeline, 1.0);
  REQUIRE(needed.ok());
  CHECK(needed->size() == timeline->needed_at(1.0)->size());
  const int sent = device.sent;
  CHECK(sent == static_cast<int>(needed->size()));
  REQUIRE(device.hold(*timeline, 1.0).ok());
  CHECK(device.sent == sent);
  const auto other = make_timeline();
  REQUIRE(device.hold(*other, 1.0).ok());
  CHECK(device.sent == 2 * sent);
  CHECK(device.there.size() == needed->size());
}

TEST_CASE("what comes while a moment is brought is for the next picture") {
  Coming timeline;
  CountingDevice device;
  const auto first = device.hold(timeline, 1.0);
  REQUIRE(first.ok());
  for (const auto& one : *first) CHECK(device.there.contains(one.segment));
  const auto second = device.hold(timeline, 1.0);
  REQUIRE(second.ok());
  CHECK(second->size() == first->size() + 1);
}

TEST_CASE("a device keeps to the budget, and drops what was needed least recently") {
  const auto whole = make_timeline();
  std::uint64_t most = 0;
  for (double t = 0; t < 3; t += 0.1) {
    std::uint64_t bytes = 0;
    const auto needed = whole->needed_at(t);
    REQUIRE(needed.ok());
    for (const auto& one : *needed) {
      bytes += kEach * whole->reader().segments()[one.segment].primitives;
    }
    most = std::max(most, bytes);
  }
  const auto timeline = make_timeline(most);
  CountingDevice device;
  for (double t = 0; t < 3; t += 0.1) {
    REQUIRE(device.hold(*timeline, t).ok());
    CHECK(kEach * device.stored_primitives() <= most);
  }
  const auto little = make_timeline(most / 4);
  const auto refused = device.hold(*little, 1.5);
  REQUIRE_FALSE(refused.ok());
  CHECK(refused.status().message().find("more than the budget") != std::string::npos);
}

}  // namespace
}  // namespace stgs::player
