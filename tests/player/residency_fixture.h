// SPDX-License-Identifier: Apache-2.0
// The units of a segment store over a clip, without threads, locks and clocks.
#pragma once

#include <memory>
#include <set>
#include <vector>

#include "catch.h"
#include "stream/deadlines.h"
#include "stream/residency.h"
#include "stream/segment_index.h"
#include "stream_fixture.h"

namespace stgs::player {

inline std::shared_ptr<const SceneReader> open_bytes(const std::vector<std::uint8_t>& bytes) {
  auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  return std::move(*reader);
}

struct StoreUnits {
  explicit StoreUnits(std::uint64_t memory_budget = kDefaultMemoryBudget) {
    budget.set_limit(Budget::Pool::kSegments, memory_budget);
    budget.set_limit(Budget::Pool::kDecodeScratch, memory_budget / 16);
    adopt(open_bytes(clip().bytes));
    play_at(0);
  }
  // As SegmentStore adopts a reader.
  void adopt(std::shared_ptr<const SceneReader> reader) {
    SegmentIndex::Update update = index.prepare(std::move(reader));
    residency.reserve(update.reader->segments().size());
    if (update.renumbered) residency.clear();
    index.adopt(std::move(update));
    residency.extend();
  }
  void play_at(double ticks, double rate = 1, bool loop = false, bool stationary = false) {
    deadlines.set_playhead({ticks, 30 * rate, index.duration(), loop, stationary}, true);
    residency.forget_full();
  }
  // Fetches a layer at once.
  bool fetch(const SegmentLayer& layer) {
    if (!residency.begin_fetch(layer, deadlines.deadline(layer))) return false;
    residency.fetched(layer);
    return true;
  }
  void decode(std::uint32_t segment) {
    residency.begin_decode(segment);
    residency.end_decode(segment);
    residency.decoded(segment, decoded_of(segment),
                      residency.state({segment, true}) == LoadState::kResident);
  }
  DecodedSegment decoded_of(std::uint32_t segment) const {
    auto set = index.reader().decode(segment);
    REQUIRE(set.ok());
    return std::make_shared<const ResidentSegment>(std::move(*set));
  }
  // Returns a segment of tier 0 that has separate spherical harmonics.
  std::uint32_t first_segment() const {
    for (std::uint32_t s = 0; s < index.size(); ++s) {
      if (index.info(s).tier == 0 && index.info(s).sh_bytes > 0) return s;
    }
    FAIL("the clip has no such segment");
    return 0;
  }
  std::uint64_t used() const { return budget.usage(Budget::Pool::kSegments).used; }

  SegmentIndex index;
  Deadlines deadlines{index, 1.0};
  Budget budget;
  std::multiset<std::uint64_t> erased;  // offsets
  Residency residency{index, deadlines, budget, 0.5,
                      [this](std::uint64_t offset) { erased.insert(offset); }};
};

}  // namespace stgs::player
