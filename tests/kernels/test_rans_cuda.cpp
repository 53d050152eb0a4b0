// SPDX-License-Identifier: Apache-2.0
// Compares the CUDA rANS decoder with the scalar decoder.
#include <cstdio>

#include "catch.h"
#include "rans_device.h"
#include "rans_planes.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

struct Case {
  Planes planes;
  Symbols bytes;
};

// Decodes all groups in one launch and compares each with the scalar decoder.
void check_groups(const std::vector<Case>& cases) {
  std::vector<DeviceGroup> groups;
  for (const Case& c : cases) groups.emplace_back(c.bytes, c.planes.n, c.planes.tables);
  DeviceDecoder(groups).decode();
  for (std::size_t g = 0; g < cases.size(); ++g) {
    const Case& c = cases[g];
    INFO("group " << g << " of " << c.planes.n << " primitives");
    const Decoded expected = decode(c.bytes, c.planes.n, c.planes.tables, true);
    Symbols all;
    for (const Symbols& plane : expected.symbols) all.insert(all.end(), plane.begin(), plane.end());
    CHECK(groups[g].symbols.read() == all);
    CHECK((groups[g].damaged.read()[0] == 0) == expected.finished);
  }
}

}  // namespace

TEST_CASE("groups of every size and kind, decoded in one launch, match the scalar decoder") {
  std::vector<Case> cases;
  unsigned kind = 0;
  for (const std::size_t n : {0u, 1u, 31u, 32u, 33u, 65u, 2047u, 2048u, 2049u, 16384u, 100000u}) {
    const Planes planes = random_planes(n, 1 + n % 7, kind++);
    cases.push_back({planes, planes.encode()});
  }
  const Planes many = random_planes(5000, 64, 0);
  cases.push_back({many, many.encode()});
  check_groups(cases);
}

TEST_CASE("damaged groups match the scalar decoder and are reported as damaged") {
  std::vector<Case> cases;
  std::mt19937 random(8);
  for (unsigned run = 0; run < 100; ++run) {
    const std::size_t n = run % 2 ? 700 : 5000;
    const Planes planes = random_planes(n, 3, run);
    Symbols bytes = planes.encode();
    for (int change = 0; change < 3; ++change) {
      const std::size_t at = random() % bytes.size();
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1 + random() % 255));
    }
    if (RansGroupDecoder::open(bytes, n).ok()) cases.push_back({planes, bytes});
  }
  REQUIRE(cases.size() > 50);
  check_groups(cases);
}
