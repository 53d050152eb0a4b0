// SPDX-License-Identifier: Apache-2.0
// Prints the speed of the rANS coder on one thread, by size and entropy, as JSON: millions of
// symbols per second of a group of 8 planes, encoded, and decoded with each instruction set of the
// CPU.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <random>

#include "../fixtures/loop_threads.h"
#include "codec/rans.h"
#include "min_time.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::bench;

namespace {

constexpr std::size_t kPlanes = 8;

// Symbols of a two-sided geometric distribution, folded to 0, 1 ..., of about this entropy.
std::vector<std::uint8_t> random_symbols(std::size_t n, double entropy) {
  std::mt19937 random(7);
  std::vector<std::uint8_t> out(n);
  if (entropy < 1.0) {
    std::bernoulli_distribution one(0.11);  // 0.5 bits
    for (auto& s : out) s = one(random);
    return out;
  }
  // The entropy of this distribution is near log2(2 e scale).
  const double scale = std::exp2(entropy) / 5.43;
  std::exponential_distribution<double> size(1.0 / scale);
  for (auto& s : out) {
    const auto d = static_cast<int>(std::lround(size(random)));
    s = static_cast<std::uint8_t>(std::min(255, (random() & 1) ? 2 * d : std::max(0, 2 * d - 1)));
  }
  return out;
}

double decode_speed(std::span<const std::uint8_t> bytes, std::size_t n, const RansLookup& lookup,
                    bool scalar) {
  std::vector<std::uint8_t> out(n);
  return millions_per_second(n * kPlanes, [&] {
    auto decoder = RansGroupDecoder::open(bytes, n, scalar);
    for (std::size_t p = 0; p < kPlanes; ++p) decoder->next_plane(lookup, out.data());
    if (!decoder->finish()) std::abort();
  });
}

nlohmann::json measure(std::size_t n, double entropy) {
  const std::vector<std::uint8_t> symbols = random_symbols(n, entropy);
  std::array<std::uint32_t, 256> counts{};
  for (const std::uint8_t s : symbols) ++counts[s];
  const RansTable table = rans_table(counts);
  const std::vector<RansPlane> planes(kPlanes, {symbols, &table});
  const auto bytes = rans_encode(planes, n);
  const auto size = static_cast<double>(n * kPlanes);
  RansLookup lookup;
  rans_lookup(table, lookup);
  ByteWriter stored;
  write_rans_table(table, stored);
  nlohmann::json out = {
      {"n", n},
      {"table_bits_per_symbol", rans_cost(table, counts) / static_cast<double>(n)},
      {"stored_bits_per_symbol", 8.0 * static_cast<double>(bytes->size()) / size},
      {"table_bytes", stored.size()},
      {"encode_msymbols_per_s",
       millions_per_second(n * kPlanes, [&] { (void)rans_encode(planes, n); })},
      {"table_us", 1e6 * min_seconds([&] { (void)rans_table(counts); })},
      {"lookup_us", 1e6 * min_seconds([&] { rans_lookup(table, lookup); })},
  };
  nlohmann::json& decode = out["decode_msymbols_per_s"];
  decode["scalar"] = decode_speed(*bytes, n, lookup, true);
  testing::for_each_vector_target(
      [&] { decode[rans_vector_target()] = decode_speed(*bytes, n, lookup, false); });
  return out;
}

}  // namespace

int main() {
  const testing::LoopThreads one_thread(1);
  nlohmann::json out = nlohmann::json::array();
  for (const std::size_t n : {500u, 1000u, 2000u, 30000u, 1000000u})
    for (const double entropy : {0.5, 2.0, 4.0, 7.0}) out.push_back(measure(n, entropy));
  std::printf("%s\n", out.dump(2).c_str());
  return 0;
}
