// SPDX-License-Identifier: Apache-2.0
// A table of the rANS coder as bytes (spec annex A.2). Each table has exactly one encoding.
#include <numeric>

#include "codec/rans.h"
#include "core/bytes.h"
#include "mutator.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

std::vector<Bytes> seeds() {
  std::vector<Bytes> out;
  Random random(1);
  for (const std::size_t kinds : {1, 2, 5, 40, 256}) {
    std::array<std::uint32_t, 256> counts{};
    for (std::size_t s = 0; s < kinds; ++s) {
      counts[random.below(256)] += static_cast<std::uint32_t>(random.below(1000));
    }
    ByteWriter bytes;
    write_rans_table(rans_table(counts), bytes);
    out.push_back(bytes.take());
  }
  return out;
}

std::uint64_t memory(View) {
  return 64 << 10;
}

}  // namespace

const Target stgs::fuzz::kTarget{"rans_table", seeds, nullptr, nullptr, nullptr, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ByteReader in({data, size});
  const auto table = read_rans_table(in);
  if (!table.ok()) return 0;
  const auto& f = table->frequency;
  require(std::accumulate(f.begin(), f.end(), 0u) == kRansTotal, "frequencies add up to 4096");
  ByteWriter out;
  write_rans_table(*table, out);
  require(out.size() == in.position() && std::equal(data, data + out.size(), out.view().begin()),
          "a table round-trips");
  RansLookup lookup;
  rans_lookup(*table, lookup);
  return 0;
}
