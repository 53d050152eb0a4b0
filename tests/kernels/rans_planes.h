// SPDX-License-Identifier: Apache-2.0
// Groups of planes of every kind for tests of the rANS coder, and a decoder that records its
// results.
#pragma once

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "catch.h"
#include "codec/rans.h"

namespace stgs::testing {

using Counts = std::array<std::uint32_t, 256>;
using Symbols = std::vector<std::uint8_t>;

struct Planes {
  std::size_t n = 0;
  std::vector<Symbols> symbols;
  std::vector<RansTable> tables;

  std::vector<std::uint8_t> encode() const {
    std::vector<RansPlane> planes;
    for (std::size_t p = 0; p < symbols.size(); ++p) planes.push_back({symbols[p], &tables[p]});
    auto bytes = rans_encode(planes, n);
    REQUIRE(bytes.ok());
    return *bytes;
  }
};

inline Counts count_symbols(const Symbols& symbols) {
  Counts counts{};
  for (const std::uint8_t s : symbols) ++counts[s];
  return counts;
}

// The kinds in order: skewed, uniform, one symbol, two symbols, almost all one symbol.
inline Symbols random_plane(std::size_t n, std::size_t kind, std::mt19937& random) {
  Symbols symbols(n);
  std::geometric_distribution<int> skewed(0.2);
  for (auto& s : symbols) {
    switch (kind % 5) {
      case 0:
        s = static_cast<std::uint8_t>(std::min(255, skewed(random)));
        break;
      case 1:
        s = static_cast<std::uint8_t>(random());
        break;
      case 2:
        s = 77;
        break;
      case 3:
        s = random() % 2 ? 255 : 0;
        break;
      default:
        s = random() % 1000 == 0 ? 9 : 200;
    }
  }
  return symbols;
}

inline Planes random_planes(std::size_t n, std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  Planes planes;
  planes.n = n;
  for (std::size_t p = 0; p < count; ++p) {
    planes.symbols.push_back(random_plane(n, p + seed, random));
    planes.tables.push_back(rans_table(count_symbols(planes.symbols.back())));
  }
  return planes;
}

struct Decoded {
  bool opened = false, finished = false;
  std::vector<Symbols> symbols;

  bool operator==(const Decoded&) const = default;
};

inline Decoded decode(std::span<const std::uint8_t> bytes, std::size_t n,
                      const std::vector<RansTable>& tables, bool scalar) {
  Decoded out;
  auto decoder = RansGroupDecoder::open(bytes, n, scalar);
  out.opened = decoder.ok();
  if (!out.opened) return out;
  RansLookup lookup;
  for (const RansTable& table : tables) {
    rans_lookup(table, lookup);
    out.symbols.emplace_back(n);
    decoder->next_plane(lookup, out.symbols.back().data());
  }
  out.finished = decoder->finish();
  return out;
}

}  // namespace stgs::testing
