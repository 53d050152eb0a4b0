// SPDX-License-Identifier: Apache-2.0
// Prints the speed of the CUDA rANS decoder by group size, as JSON lines: billions of symbols and
// primitives per second, for two million primitives of 40 planes in one launch. Measures decoding
// only, from device memory to device memory.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>

#include "rans_device.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

constexpr std::size_t kPrimitives = 2000000, kPlanes = 40;

// Planes of n symbols each, with an entropy of 0.5 to 7 bits.
DeviceGroup make_group(std::size_t n) {
  std::mt19937 random(5);
  std::vector<std::vector<std::uint8_t>> symbols(kPlanes, std::vector<std::uint8_t>(n));
  std::vector<RansTable> tables(kPlanes);
  std::vector<RansPlane> planes;
  for (std::size_t p = 0; p < kPlanes; ++p) {
    std::exponential_distribution<double> size(12.0 / std::exp2(static_cast<double>(p % 8)));
    std::array<std::uint32_t, 256> counts{};
    for (auto& s : symbols[p]) {
      s = static_cast<std::uint8_t>(std::min(255.0, size(random)));
      ++counts[s];
    }
    tables[p] = rans_table(counts);
    planes.push_back({symbols[p], &tables[p]});
  }
  const auto bytes = rans_encode(planes, n);
  if (!bytes.ok()) throw std::runtime_error(bytes.status().message());
  return {*bytes, n, tables};
}

void measure(std::size_t n) {
  std::vector<DeviceGroup> groups;
  for (std::size_t done = 0; done < kPrimitives; done += n) groups.push_back(make_group(n));
  DeviceDecoder decoder(groups);
  double best = 1e30;
  for (int run = 0; run < 20; ++run) {
    const auto start = std::chrono::steady_clock::now();
    decoder.decode();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    best = std::min(best, took.count());
  }
  const double primitives = static_cast<double>(groups.size() * n);
  std::printf(
      "{\"group_primitives\": %zu, \"groups\": %zu, \"planes\": %zu, \"ms\": %.3f, "
      "\"gsymbols_per_s\": %.1f, \"gprimitives_per_s\": %.2f}\n",
      n, groups.size(), kPlanes, best * 1e3, primitives * kPlanes / best * 1e-9,
      primitives / best * 1e-9);
}

}  // namespace

int main() {
  try {
    for (const std::size_t n : {2000u, 30000u, 1000000u}) measure(n);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 4;
  }
  return 0;
}
