// SPDX-License-Identifier: Apache-2.0
// Changes inputs at random, but the same way on every machine.
#pragma once

#include "fuzz_target.h"

namespace stgs::fuzz {

// SplitMix64: small, and specified, unlike the distributions of the standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  // Of [0, count); 0 for a count of 0.
  std::size_t below(std::size_t count) {
    return count == 0 ? 0 : static_cast<std::size_t>(next() % count);
  }
  bool chance(std::size_t of) { return below(of) == 0; }

 private:
  std::uint64_t state_;
};

// `base` with one to four changes, `other` being where spliced bytes come from; at most
// `most_bytes` long.
Bytes mutate(const Target& target, View base, View other, std::size_t most_bytes, Random& random);

}  // namespace stgs::fuzz
