// SPDX-License-Identifier: Apache-2.0
// The primitives that a timeline shows at a given time.
#pragma once

#include <set>
#include <string>

#include "catch.h"
#include "fixtures/fragment_fixture.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

// Fingerprints of the primitives that are active at `seconds`.
inline std::multiset<std::string> active_fingerprints(Timeline& timeline, double seconds) {
  const auto active = timeline.at(seconds);
  REQUIRE(active.ok());
  std::multiset<std::string> out;
  for (const auto& part : active->segments) {
    const auto prints = testing::fingerprints(part.set->gather(*part.candidates));
    out.insert(prints.begin(), prints.end());
  }
  return out;
}

}  // namespace stgs::player
