// SPDX-License-Identifier: Apache-2.0
// Mutates inputs at random, identically on every machine.
#pragma once

#include "fuzz_target.h"

namespace stgs::fuzz {

// SplitMix64: small, and fully specified, unlike the distributions of the standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  // Returns a number in [0, count), or 0 if count is 0.
  std::size_t below(std::size_t count) {
    return count == 0 ? 0 : static_cast<std::size_t>(next() % count);
  }
  // Returns true with probability 1 / n.
  bool one_in(std::size_t n) { return below(n) == 0; }

 private:
  std::uint64_t state_;
};

// Returns `base` with one to four changes and at most `max_bytes` bytes. Spliced bytes come from
// `other`.
Bytes mutate(const Target& target, View base, View other, std::size_t max_bytes, Random& random);

}  // namespace stgs::fuzz
