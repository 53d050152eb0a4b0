// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "catch.h"
#include "rans_planes.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

std::uint32_t sum_of(const RansTable& table) {
  std::uint32_t sum = 0;
  for (const std::uint32_t f : table.frequency) sum += f;
  return sum;
}

// Decodes with the scalar decoder and checks that every vector target agrees.
Decoded decode_on_all_targets(std::span<const std::uint8_t> bytes, std::size_t n,
                              const std::vector<RansTable>& tables) {
  const Decoded scalar = decode(bytes, n, tables, true);
  for_each_vector_target([&] {
    INFO(rans_vector_target());
    if (decode(bytes, n, tables, false) != scalar) FAIL("differs from the scalar decoder");
  });
  return scalar;
}

void check_round_trip(const Planes& planes) {
  const auto bytes = planes.encode();
  const Decoded decoded = decode_on_all_targets(bytes, planes.n, planes.tables);
  CHECK(decoded.opened);
  CHECK(decoded.finished);
  CHECK(decoded.symbols == planes.symbols);
}

// Damage is either detected or yields other valid symbols, which a checksum must catch.
void check_damage(const Planes& planes, std::span<const std::uint8_t> bytes) {
  const Decoded decoded = decode_on_all_targets(bytes, planes.n, planes.tables);
  if (!decoded.opened || !decoded.finished) return;
  Planes others = planes;
  others.symbols = decoded.symbols;
  if (others.encode() != Symbols(bytes.begin(), bytes.end())) FAIL("undetected damage");
}

// Two planes of 65 primitives, in two lanes: the example of spec A.7.
Planes spec_example() {
  Planes planes;
  planes.n = 300;
  planes.symbols.assign(2, Symbols(300));
  for (std::size_t i = 0; i < 300; ++i) {
    planes.symbols[0][i] = static_cast<std::uint8_t>(i * i % 7);
    planes.symbols[1][i] = i % 10 == 3 ? 5 : 0;
  }
  planes.tables.resize(2);
  planes.tables[0].frequency = {600, 1200, 1000, 0, 1296};
  planes.tables[1].frequency = {3686, 0, 0, 0, 0, 410};
  return planes;
}

std::uint32_t random_below(std::mt19937& random, std::uint32_t limit) {
  return static_cast<std::uint32_t>(random()) % limit;
}

// Counts of up to 256 symbols, log-uniform up to 2^bits.
Counts random_counts(std::mt19937& random, std::uint32_t bits) {
  Counts counts{};
  for (std::uint32_t left = 1 + random_below(random, 256); left > 0; --left) {
    const double log = random_below(random, 100 * bits) / 100.0;
    counts[random() % 256] = 1 + static_cast<std::uint32_t>(std::exp2(log));
  }
  return counts;
}

Symbols bytes_of(const RansTable& table) {
  ByteWriter out;
  write_rans_table(table, out);
  return out.take();
}

}  // namespace

TEST_CASE("planes of every size round-trip on every vector target") {
  const auto n = GENERATE(0u, 1u, 2u, 31u, 32u, 33u, 64u, 65u, 511u, 513u, 1000u, 1983u, 1984u,
                          1985u, 2047u, 2048u, 2049u, 5000u);
  const auto count = GENERATE(1u, 2u, 5u, 16u);
  check_round_trip(random_planes(n, count, n % 5));
}

TEST_CASE("large groups of planes round-trip") {
  check_round_trip(random_planes(100000, 10, 0));
  check_round_trip(random_planes(2500, 64, 3));
}

TEST_CASE("a group without planes or symbols has no bytes") {
  CHECK(random_planes(3000, 0, 0).encode().empty());
  CHECK(random_planes(0, 3, 0).encode().empty());
}

TEST_CASE("planes without words after planes with words decode completely") {
  std::mt19937 random(4);
  Planes planes = random_planes(2048, 1, 1);
  for (int p = 0; p < 3; ++p) {
    planes.symbols.push_back(random_plane(2048, 2, random));
    planes.tables.push_back(rans_table(count_symbols(planes.symbols.back())));
  }
  check_round_trip(planes);
}

TEST_CASE("the size is within 0.5 % of the code length of the tables, plus the states") {
  for (std::size_t kind = 0; kind < 5; ++kind) {
    std::mt19937 random(9);
    Planes planes;
    planes.n = 100000;
    double bits = 0;
    for (int p = 0; p < 16; ++p) {
      planes.symbols.push_back(random_plane(planes.n, kind, random));
      planes.tables.push_back(rans_table(count_symbols(planes.symbols.back())));
      bits += rans_cost(planes.tables.back(), count_symbols(planes.symbols.back()));
    }
    const std::size_t blocks = rans_blocks(planes.n);
    const double states = 4.0 * static_cast<double>(blocks + planes.n / kRansLaneSymbols + 1);
    CHECK(static_cast<double>(planes.encode().size()) <= bits / 8 * 1.005 + states);
  }
}

TEST_CASE("a block has a power of two of lanes with up to 256 symbols each") {
  const std::pair<std::size_t, std::size_t> cases[] = {
      {1, 1}, {256, 1}, {257, 2}, {1024, 4}, {1025, 8}, {8192, 32}, {8193, 33}, {12000, 48}};
  for (const auto& [n, states] : cases) {
    Planes planes = random_planes(n, 1, 2);  // one symbol: no words
    CHECK(planes.encode().size() == 4 * (rans_blocks(n) - 1 + states));
  }
}

TEST_CASE("the example of the specification has the specified bytes") {
  const Planes planes = spec_example();
  const Symbols bytes = planes.encode();
  CHECK(bytes == Symbols{0xF1, 0xE1, 0xCB, 0x1E, 0x7D, 0xA2, 0x6B, 0x09, 0x2C, 0x44, 0xD7, 0xD1,
                         0xA4, 0x45, 0x40, 0xBD, 0x9F, 0x0A, 0x62, 0xAE, 0xAA, 0x45, 0xB0, 0x00,
                         0xBF, 0x6B, 0x11, 0x19, 0x31, 0x19, 0xB4, 0xAF, 0x3F, 0x35, 0x4B, 0xE1,
                         0xC6, 0xF6, 0x60, 0x5F, 0xAD, 0x9A, 0xBB, 0x6E, 0x2B, 0x13, 0x98, 0x90,
                         0x60, 0x5C, 0xE2, 0xE8, 0x9F, 0x8A, 0x53, 0xFF, 0xB6, 0x95, 0x10, 0xC1,
                         0xB9, 0x34, 0x3B, 0xAB, 0x7D, 0xF9, 0xDD, 0x6B, 0xF4, 0x32, 0x2C, 0xA2,
                         0x11, 0x0E, 0x6A, 0x08, 0x5B, 0xC8, 0x10, 0xCE, 0xC3, 0x3B, 0x51, 0x9C,
                         0x82, 0x50, 0x63, 0xCA, 0xE5, 0xCC, 0xEF, 0x97, 0xCA, 0x2C, 0x9A, 0x42});
  CHECK(bytes_of(planes.tables[0]) == Symbols{0x04, 0x62, 0x21, 0xAC, 0xD1, 0x0F, 0x20});
  CHECK(bytes_of(planes.tables[1]) == Symbols{0x05, 0x68, 0x06, 0x01, 0x40, 0x00});
  check_round_trip(planes);
}

TEST_CASE("rans_encode rejects symbols without a table entry, wrong sizes and too many planes") {
  const Symbols symbols{1, 2, 3};
  const RansTable table = rans_table(count_symbols({1, 2}));
  const RansTable empty;
  const auto code = [&](std::size_t n, const RansTable& t) {
    const RansPlane plane{symbols, &t};
    return rans_encode({&plane, 1}, n).status().code();
  };
  CHECK(code(3, table) == StatusCode::kUsage);
  CHECK(code(3, empty) == StatusCode::kUsage);
  CHECK(code(4, rans_table(count_symbols(symbols))) == StatusCode::kUsage);
  CHECK(code(3, rans_table(count_symbols(symbols))) == StatusCode::kOk);
  CHECK(rans_encode(std::vector<RansPlane>(65, {symbols, &table}), 3).status().code() ==
        StatusCode::kUsage);
}

TEST_CASE("a truncated or extended group is rejected") {
  for (const std::size_t n : {1u, 300u, 8300u}) {
    const Planes planes = random_planes(n, n > 1000 ? 1 : 3, 0);
    const Symbols complete = planes.encode();
    for (std::size_t size = 0; size < complete.size(); ++size) {
      const Symbols cut(complete.begin(), complete.begin() + static_cast<std::ptrdiff_t>(size));
      if (decode_on_all_targets(cut, n, planes.tables).finished) FAIL("cut at " << size);
    }
    Symbols longer = complete;
    longer.push_back(0);
    CHECK_FALSE(decode(longer, n, planes.tables, true).finished);
    CHECK_FALSE(RansGroupDecoder::open(complete, n + kRansBlock).ok());
    CHECK_FALSE(RansGroupDecoder::open(complete, static_cast<std::size_t>(-1)).ok());
  }
}

TEST_CASE("a changed byte is detected or decodes to the same other symbols on every target") {
  for (const std::size_t n : {70u, 1000u, 8300u}) {
    const Planes planes = random_planes(n, n < 100 ? 6 : 1, 0);
    const Symbols complete = planes.encode();
    std::mt19937 random(1);
    for (std::size_t at = 0; at < complete.size(); at += n < 100 ? 1 : 17) {
      Symbols damaged = complete;
      damaged[at] = static_cast<std::uint8_t>(damaged[at] ^ (1 + random() % 255));
      check_damage(planes, damaged);
    }
  }
}

TEST_CASE("arbitrary bytes decode without reads out of bounds") {
  std::mt19937 random(6);
  const Planes planes = random_planes(8400, 4, 0);
  for (int run = 0; run < 200; ++run) {
    const std::uint32_t words[2] = {random_below(random, 90), random_below(random, 90)};
    Symbols bytes(4 * (1 + 32 + 1) + 2 * (words[0] + words[1]));
    // Odd bytes, so that every state is valid.
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random() | 1);
    for (std::size_t i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(words[0] >> (i * 8));
    check_damage(planes, bytes);
  }
}

TEST_CASE("a state below 65536 is rejected") {
  const Planes planes = random_planes(70, 2, 0);
  Symbols bytes = planes.encode();
  bytes[2] = bytes[3] = 0;
  CHECK_FALSE(RansGroupDecoder::open(bytes, 70).ok());
}

TEST_CASE("moving a slot of a table to another symbol never shortens the code") {
  std::mt19937 random(2);
  for (int run = 0; run < 40; ++run) {
    const Counts counts = random_counts(random, 22);
    const RansTable table = rans_table(counts);
    REQUIRE(sum_of(table) == kRansTotal);
    double max_gain = 0, min_loss = 1e300;
    for (std::size_t s = 0; s < 256; ++s) {
      REQUIRE((table.frequency[s] > 0) == (counts[s] > 0));
      const double c = counts[s], f = table.frequency[s];
      if (c == 0) continue;
      max_gain = std::max(max_gain, c * std::log2((f + 1) / f));
      if (f > 1) min_loss = std::min(min_loss, c * std::log2(f / (f - 1)));
    }
    CHECK(max_gain <= min_loss * 1.0001);
  }
}

TEST_CASE("tables of no counts, one count and the largest counts are valid") {
  CHECK(rans_table(Counts{}).frequency[0] == kRansTotal);
  Counts counts{};
  counts[255] = 1;
  CHECK(rans_table(counts).frequency[255] == kRansTotal);
  counts.fill(0xFFFFFFFFu);
  for (const std::uint32_t f : rans_table(counts).frequency) CHECK(f == 16);
}

TEST_CASE("rans_cost is the code length, and infinite if a symbol is missing from the table") {
  Counts counts{};
  counts[3] = 1000;
  counts[4] = 24;
  RansTable table;
  table.frequency[3] = 4000;
  table.frequency[4] = 96;
  const double expected = 1000 * std::log2(4096.0 / 4000) + 24 * std::log2(4096.0 / 96);
  CHECK(rans_cost(table, counts) == Approx(expected).epsilon(1e-6));
  counts[5] = 1;
  CHECK(std::isinf(rans_cost(table, counts)));
}

TEST_CASE("tables round-trip, and small tables take few bytes") {
  std::mt19937 random(3);
  for (int run = 0; run < 300; ++run) {
    const RansTable table = rans_table(random_counts(random, 12));
    ByteWriter out;
    write_rans_table(table, out);
    out.u8(0xAB);
    ByteReader in(out.view());
    const auto read = read_rans_table(in);
    REQUIRE(read.ok());
    CHECK(*read == table);
    CHECK(in.left() == 1);
  }
  Counts counts{};
  counts[0] = 5;
  CHECK(bytes_of(rans_table(counts)).size() == 1);
  for (const std::size_t s : {1u, 255u}) {
    counts = {};
    counts[s] = 5;
    CHECK(bytes_of(rans_table(counts)).size() <= 5);
  }
  std::geometric_distribution<int> skewed(0.15);
  Symbols symbols(30000);
  for (auto& s : symbols) s = static_cast<std::uint8_t>(std::min(255, skewed(random)));
  CHECK(bytes_of(rans_table(count_symbols(symbols))).size() <= 60);
}

TEST_CASE("invalid table bytes are rejected, and no two encodings represent one table") {
  const auto check = [](const Symbols& bytes) {
    ByteReader in(bytes);
    const auto table = read_rans_table(in);
    if (!table.ok()) return;
    const Symbols taken(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(in.position()));
    if (sum_of(*table) != kRansTotal || bytes_of(*table) != taken)
      FAIL("accepted bytes that encode no table");
  };
  check({});
  for (unsigned value = 0; value < 65536; ++value)
    check({static_cast<std::uint8_t>(value), static_cast<std::uint8_t>(value >> 8)});
  std::mt19937 random(5);
  for (int run = 0; run < 50000; ++run) {
    Symbols bytes(random() % 40);
    const bool dense = random() % 2;  // the density of bits controls the length of codes
    for (auto& b : bytes) b = static_cast<std::uint8_t>(dense ? random() : random() & random());
    check(bytes);
  }
  const Symbols complete = bytes_of(spec_example().tables[0]);
  for (std::size_t size = 0; size < complete.size(); ++size) {
    ByteReader in(std::span<const std::uint8_t>(complete).first(size));
    CHECK_FALSE(read_rans_table(in).ok());
  }
}
