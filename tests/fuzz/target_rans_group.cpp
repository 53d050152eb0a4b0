// SPDX-License-Identifier: Apache-2.0
// A group of rANS planes (spec annex A.3 to A.6). The scalar and the vector decoder give the same
// symbols, also for damaged bytes.
//
// Input: u16 primitives, u8 planes, a table per plane (A.2), then the group up to the end.
#include <algorithm>

#include "codec/rans.h"
#include "core/bytes.h"
#include "mutator.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

Bytes make_seed(std::size_t n, std::size_t planes, std::uint64_t random_seed) {
  Random random(random_seed);
  std::vector<Bytes> symbols(planes, Bytes(n));
  std::vector<RansTable> tables;
  std::vector<RansPlane> coded;
  for (Bytes& plane : symbols) {
    std::array<std::uint32_t, 256> counts{};
    const std::size_t kinds = 1 + random.below(20);
    for (std::uint8_t& symbol : plane) {
      symbol = static_cast<std::uint8_t>(random.below(1 + random.below(kinds)));
      ++counts[symbol];
    }
    tables.push_back(rans_table(counts));
  }
  for (std::size_t p = 0; p < planes; ++p) coded.push_back({symbols[p], &tables[p]});
  const auto group = rans_encode(coded, n);
  require(group.ok(), "seeds can be encoded");
  ByteWriter out;
  out.u16(static_cast<std::uint16_t>(n));
  out.u8(static_cast<std::uint8_t>(planes));
  for (const RansTable& table : tables) write_rans_table(table, out);
  out.bytes(*group);
  return out.take();
}

std::vector<Bytes> seeds() {
  return {make_seed(1, 1, 1), make_seed(65, 2, 2), make_seed(300, 3, 3), make_seed(2048, 2, 4),
          make_seed(4100, 4, 5)};
}

// Offsets, states and symbols of at most 64 planes of 65,535 primitives.
std::uint64_t memory(View input) {
  return 8 * input.size() + (std::uint64_t{3} << 20);
}

}  // namespace

const Target stgs::fuzz::kTarget{"rans_group", seeds, nullptr, nullptr, nullptr, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ByteReader in({data, size});
  const std::size_t n = in.u16();
  const std::size_t planes = std::min<std::size_t>(in.u8(), kRansPlanes);
  std::vector<RansTable> tables;
  for (std::size_t p = 0; p < planes; ++p) {
    auto table = read_rans_table(in);
    if (!table.ok()) return 0;
    tables.push_back(*table);
  }
  // A separate copy, so that sanitizers catch reads past its end.
  const View remainder = in.bytes(in.left());
  const Bytes group(remainder.begin(), remainder.end());
  auto scalar = RansGroupDecoder::open(group, n, true), vector = RansGroupDecoder::open(group, n);
  require(scalar.ok() == vector.ok(), "both decoders accept the same groups");
  if (!scalar.ok()) return 0;
  Bytes a(n), b(n);
  RansLookup lookup;
  for (const RansTable& table : tables) {
    rans_lookup(table, lookup);
    scalar->next_plane(lookup, a.data());
    vector->next_plane(lookup, b.data());
    require(a == b, "both decoders give the same symbols");
  }
  require(scalar->finish() == vector->finish(),
          "both decoders agree on whether the group is intact");
  return 0;
}
