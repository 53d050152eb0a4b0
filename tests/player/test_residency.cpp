// SPDX-License-Identifier: Apache-2.0
// The invariants of the segments in memory.
#include <random>

#include "residency_fixture.h"
#include "stream/change_monitor.h"

namespace stgs::player {
namespace {

bool is_in_memory(LoadState state) {
  return state == LoadState::kInFlight || state == LoadState::kResident;
}

// A layer is charged if and only if it is in memory or in flight, and nothing else is.
void check_charges(const StoreUnits& units) {
  std::uint64_t sum = 0;
  for (const SegmentLayer& layer : units.index.file_order()) {
    const std::uint64_t charged = units.residency.charged_bytes(layer);
    const LoadState state = units.residency.state(layer);
    if (!is_in_memory(state)) REQUIRE(charged == 0);
    // The encoded bytes of a segment that is completely decoded are freed.
    if (state == LoadState::kInFlight || (state == LoadState::kResident && !layer.sh))
      REQUIRE(charged > 0);
    sum += charged;
  }
  REQUIRE(sum == units.used());
  REQUIRE(sum <= units.budget.usage(Budget::Pool::kSegments).limit);
}

TEST_CASE("random sequences of fetches, decodes, failures and seeks keep the invariants") {
  for (unsigned seed = 0; seed < 4; ++seed) {
    std::mt19937 random(seed);
    const auto pick = [&](std::size_t n) { return random() % n; };
    StoreUnits units(400'000);
    const std::vector<SegmentLayer>& layers = units.index.file_order();
    std::vector<SegmentLayer> fetching;
    std::vector<std::uint32_t> decoding;
    int refused = 0, evicted = 0;
    for (int k = 0; k < 3000; ++k) {
      const SegmentLayer layer = layers[pick(layers.size())];
      const LoadState state = units.residency.state(layer);
      switch (pick(6)) {
        case 0:
        case 1:
          if (is_in_memory(state)) break;
          if (units.residency.begin_fetch(layer, units.deadlines.deadline(layer))) {
            fetching.push_back(layer);
          } else {
            ++refused;
            REQUIRE(units.residency.state(layer) == state);
          }
          break;
        case 2: {
          if (fetching.empty()) break;
          const SegmentLayer done = fetching[pick(fetching.size())];
          std::erase(fetching, done);
          const std::size_t how = pick(8);
          if (how == 0) units.residency.fetch_cancelled(done);
          if (how == 1) units.residency.failed(done, false, k);
          if (how > 1) units.residency.fetched(done);
          break;
        }
        case 3:
          if (!units.residency.is_decodable(layer.segment)) break;
          units.residency.begin_decode(layer.segment);
          decoding.push_back(layer.segment);
          break;
        case 4: {
          if (decoding.empty()) break;
          const std::uint32_t done = decoding[pick(decoding.size())];
          std::erase(decoding, done);
          units.residency.end_decode(done);
          const bool has_sh = units.residency.state({done, true}) == LoadState::kResident;
          units.residency.decoded(done, units.decoded_of(done), has_sh);
          break;
        }
        case 5:
          units.play_at(static_cast<double>(pick(90)));
      }
      check_charges(units);
      // Segments in use are never evicted.
      for (const SegmentLayer& one : fetching)
        REQUIRE(units.residency.state(one) == LoadState::kInFlight);
      for (const std::uint32_t one : decoding)
        REQUIRE(units.residency.state({one, false}) == LoadState::kResident);
      std::uint64_t primitives = 0;
      std::set<std::uint32_t> decodable;
      for (std::uint32_t s = 0; s < units.index.size(); ++s) {
        if (units.residency.is_decodable(s)) decodable.insert(s);
        if (const DecodedSegment& one = units.residency.resident(s)) primitives += one->set.size();
      }
      REQUIRE(primitives == units.residency.stored_primitives());
      const std::vector<std::uint32_t>& listed = units.residency.decodable();
      REQUIRE(std::set(listed.begin(), listed.end()) == decodable);
      REQUIRE(listed.size() == decodable.size());
      REQUIRE(units.residency.is_decoding() == !(decodable.empty() && decoding.empty()));
      evicted = static_cast<int>(units.erased.size());
    }
    CHECK(refused > 0);
    CHECK(evicted > 0);
  }
}

TEST_CASE("a segment that is completely decoded frees its encoded bytes") {
  StoreUnits units;
  const std::uint32_t s = units.first_segment();
  const LocatedLayer base = units.index.locate({s, false}), sh = units.index.locate({s, true});
  REQUIRE(units.fetch(base.layer));
  units.decode(s);
  CHECK(units.used() == units.index.memory_bytes(base.layer));
  CHECK(units.erased.empty());
  REQUIRE(units.fetch(sh.layer));
  REQUIRE(units.residency.is_decodable(s));
  units.decode(s);
  CHECK(units.used() == units.index.memory_bytes(base.layer) - base.bytes);
  CHECK(units.erased == std::multiset{base.offset, sh.offset});
  CHECK_FALSE(units.residency.is_decodable(s));
}

TEST_CASE("the segments that are needed last are evicted first, and none that is needed sooner") {
  StoreUnits units;
  std::vector<SegmentLayer> bases;
  for (std::uint32_t s = 0; s < units.index.size(); ++s) {
    if (units.index.info(s).tier == 0) bases.push_back({s, false});
  }
  const auto sooner = [&](const SegmentLayer& a, const SegmentLayer& b) {
    return units.deadlines.deadline(a) < units.deadlines.deadline(b);
  };
  std::sort(bases.begin(), bases.end(), sooner);
  const auto size = [&](const SegmentLayer& base) { return units.index.memory_bytes(base); };
  // The first one that fits in place of the last one.
  const SegmentLayer last = bases.back();
  const auto soon = std::find_if(bases.begin(), bases.end(),
                                 [&](const auto& base) { return size(base) <= size(last); });
  const SegmentLayer needed = *soon;
  REQUIRE(needed != last);
  bases.erase(soon);
  for (const SegmentLayer& base : bases) REQUIRE(units.fetch(base));
  units.budget.set_limit(Budget::Pool::kSegments, units.used());
  CHECK_FALSE(units.residency.begin_fetch(needed, 1e9));  // less urgent than all others
  CHECK(units.erased.empty());
  REQUIRE(units.residency.begin_fetch(needed, units.deadlines.deadline(needed)));
  CHECK(units.residency.state(last) == LoadState::kMissing);
  bases.pop_back();
  for (const SegmentLayer& base : bases) CHECK(units.residency.state(base) == LoadState::kResident);
}

TEST_CASE("failed layers are retried with exponential backoff, permanent failures never") {
  StoreUnits units;
  const SegmentLayer layer{units.first_segment(), false};
  double now = 10;
  for (const double backoff : {0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0}) {
    units.residency.failed(layer, false, now);
    CHECK(units.residency.retry_at(layer) == Approx(now + backoff));
    now = units.residency.retry_at(layer);
  }
  REQUIRE(units.fetch({layer.segment, false}));
  REQUIRE(units.fetch({layer.segment, true}));
  units.residency.failed(layer, true, now);
  CHECK(std::isinf(units.residency.retry_at(layer)));
  // Spherical harmonics are useless without their base.
  CHECK(units.residency.state({layer.segment, true}) == LoadState::kMissing);
  CHECK(units.used() == 0);
}

TEST_CASE("playback does not wait for a base that failed, even while it is retried") {
  StoreUnits units;
  const auto active = units.index.reader().segments_between(40, 40);
  CHECK_FALSE(units.residency.ready(40));
  for (const std::uint32_t s : active) {
    if (units.index.info(s).tier > 0) continue;
    units.residency.failed({s, false}, false, 0);
    REQUIRE(units.residency.begin_fetch({s, false}, 0));
  }
  CHECK(units.residency.ready(40));
  CHECK(units.residency.layers(40) == 0);
}

TEST_CASE("layers that do not fit count as complete until a jump or until one fits") {
  StoreUnits units;
  const double ticks = 0;
  CHECK_FALSE(units.residency.is_complete(ticks));
  units.residency.set_full_from(0);
  CHECK(units.residency.is_complete(ticks));
  units.play_at(0);
  CHECK_FALSE(units.residency.is_complete(ticks));
  units.residency.set_full_from(0);
  REQUIRE(units.fetch({units.first_segment(), false}));
  units.decode(units.first_segment());
  CHECK_FALSE(units.residency.is_complete(ticks));
  units.residency.set_full_from(0);
  std::uint32_t later = 0;
  while (!units.deadlines.is_ahead(later)) ++later;
  REQUIRE(units.residency.begin_fetch({later, false}, -1));  // sooner than those that do not fit
  CHECK(units.residency.is_complete(ticks));
}

TEST_CASE("a renumbered file starts with nothing in memory") {
  StoreUnits units;
  const SegmentLayer layer{units.first_segment(), false};
  REQUIRE(units.fetch(layer));
  const std::uint64_t offset = units.index.file_offset(layer);
  const std::uint64_t before = units.index.generation();
  units.adopt(units.index.snapshot().reader);  // the same segments: nothing changes
  CHECK(units.index.generation() == before);
  CHECK(units.used() > 0);
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  auto other = encode_scene(testing::random_scene(500, 1, kFrames, 9), settings);
  REQUIRE(other.ok());
  units.adopt(open_bytes(*other));
  CHECK(units.index.generation() == before + 1);
  CHECK(units.used() == 0);
  CHECK(units.erased.count(offset) == 1);
  for (const SegmentLayer& one : units.index.file_order())
    CHECK(units.residency.state(one) == LoadState::kMissing);
}

TEST_CASE("invalid data is damage, unless the file was replaced") {
  using Cause = ChangeMonitor::Cause;
  const FileChanges none, shrunk{true, false}, modified{false, true};
  ChangeMonitor monitor(1);
  CHECK(monitor.decode_failed(StatusCode::kInvalidFile, false, none, 10) == Cause::kDamage);
  CHECK(monitor.decode_failed(StatusCode::kUnsupported, true, modified, 10) == Cause::kDamage);
  CHECK(monitor.decode_failed(StatusCode::kNotBuilt, false, modified, 10) == Cause::kNotBuilt);
  CHECK(monitor.decode_failed(StatusCode::kNoMemory, false, modified, 10) == Cause::kMachine);
  CHECK_FALSE(monitor.is_replaced());
  CHECK(monitor.decode_failed(StatusCode::kInvalidFile, false, modified, 10) == Cause::kReplaced);
  CHECK(monitor.is_replaced());
  CHECK_FALSE(monitor.decoded(none, 39));  // may have been fetched before
  CHECK_FALSE(monitor.decoded(shrunk, 41));
  CHECK(monitor.decoded(none, 41));
  CHECK_FALSE(monitor.is_replaced());
  monitor.read_failed(true, shrunk);  // a Follower watches this file
  monitor.read_failed(false, none);
  CHECK_FALSE(monitor.is_replaced());
  monitor.read_failed(false, shrunk);
  CHECK(monitor.is_replaced());
}

}  // namespace
}  // namespace stgs::player
