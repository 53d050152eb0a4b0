// SPDX-License-Identifier: Apache-2.0
// The digits and tables that the writer chooses.
#include <algorithm>
#include <cmath>
#include <random>

#include "catch.h"
#include "codec/layout_plan.h"
#include "codec/planes.h"
#include "quantise/steps.h"

using namespace stgs;

namespace {

SymbolCounts counts_of(std::mt19937& random, double scale, std::size_t n) {
  SymbolCounts counts{};
  std::exponential_distribution<double> value(1.0 / scale);
  for (std::size_t i = 0; i < n; ++i) {
    ++counts[static_cast<std::size_t>(std::min(255.0, value(random)))];
  }
  return counts;
}

double stored_bits(const RansTable& table) {
  ByteWriter out;
  write_rans_table(table, out);
  return 8.0 * static_cast<double>(out.size());
}

// Bits of the symbols of the planes and of the tables.
double bits_of(const std::vector<SymbolCounts>& planes, const TablePlan& plan) {
  double bits = 0.0;
  for (const RansTable& table : plan.tables) bits += stored_bits(table);
  for (std::size_t p = 0; p < planes.size(); ++p) {
    bits += rans_cost(plan.tables[plan.table_of[p]], planes[p]);
  }
  return bits;
}

Integers integers_of(std::vector<std::uint32_t> values) {
  Integers out;
  out.attribute = Attribute::kOpacity;
  out.mapping = Mapping::kLinear;
  out.step.exponent = -2;
  out.components = 1;
  out.values = std::move(values);
  return out;
}

// The values that a reader decodes from the planes of one component, before it undoes the
// prediction.
std::vector<std::uint32_t> values_of(const StreamRow& row, const std::vector<std::uint8_t>& planes,
                                     std::size_t n) {
  std::vector<std::uint32_t> out(n, 0);
  int shift = 0;
  for (std::size_t d = 0; d < row.digits; shift += row.digit_bits[d++]) {
    for (std::size_t i = 0; i < n; ++i) out[i] |= std::uint32_t{planes[d * n + i]} << shift;
  }
  return out;
}

}  // namespace

TEST_CASE("steps are odd multiples of powers of two, within the resolution of an octave") {
  for (double octaves = -90.0; octaves < 90.0; octaves += 0.0137) {
    for (const int in_octave : {kCoarseSteps, kFineSteps}) {
      const Step near = step_near(octaves, in_octave), below = step_below(octaves, in_octave);
      REQUIRE(near.multiplier % 2 == 1);
      REQUIRE(near.multiplier < 2 * in_octave);
      REQUIRE(std::abs(std::log2(size_of(near)) - octaves) <= 0.75 / in_octave);
      REQUIRE(std::log2(size_of(below)) <= octaves + 1e-6);
      REQUIRE(std::log2(size_of(below)) > octaves - 1.5 / in_octave);
    }
  }
  CHECK(step_below(-3.0, kFineSteps) == Step{-3, 1});
  CHECK(step_near(std::log2(5.0), kCoarseSteps) == Step{0, 5});
}

TEST_CASE("floats in units of the last place round-trip 1 and bracket other values") {
  for (const Step step : {Step{21, 1}, Step{18, 13}, Step{0, 255}}) {
    CHECK(from_truncated(truncated_steps(1.0f, step), step) == 1.0f);
    for (const float x : {1e-3f, 0.37f, 0.999f, 1.7f, 1000.0f}) {
      const std::int32_t k = truncated_steps(x, step);
      CHECK(from_truncated(k - 1, step) < x);
      CHECK(x < from_truncated(k + 1, step));
    }
  }
}

TEST_CASE("planes share tables where that is cheaper than separate tables") {
  std::mt19937 random(5);
  std::vector<SymbolCounts> planes;
  for (int p = 0; p < 60; ++p) planes.push_back(counts_of(random, p % 3 == 0 ? 2.0 : 30.0, 1500));
  const TablePlan plan = plan_tables(planes);
  CHECK(plan.tables.size() < 10);
  TablePlan alone;
  for (std::size_t p = 0; p < planes.size(); ++p) {
    alone.tables.push_back(rans_table(planes[p]));
    alone.table_of.push_back(static_cast<std::uint16_t>(p));
  }
  CHECK(bits_of(planes, plan) < 0.95 * bits_of(planes, alone));
}

TEST_CASE("a plane of one symbol gets a table of that symbol alone") {
  std::mt19937 random(6);
  std::vector<SymbolCounts> planes(20);
  for (std::size_t p = 0; p < planes.size(); ++p) {
    if (p % 2 == 0) {
      planes[p][p % 4] = 5000;
    } else {
      planes[p][p % 4 - 1] = 100000;  // like its neighbour, except for one symbol
      planes[p][9] = 1;
    }
  }
  const TablePlan plan = plan_tables(planes);
  for (std::size_t p = 0; p < planes.size(); p += 2) {
    CHECK(only_symbol(plan.tables[plan.table_of[p]]) == static_cast<int>(p % 4));
    CHECK(rans_cost(plan.tables[plan.table_of[p]], planes[p]) == 0.0);
  }
}

TEST_CASE("a plan never exceeds the maximum number of tables, and each table codes its planes") {
  std::mt19937 random(7);
  std::vector<SymbolCounts> planes;
  for (int p = 0; p < 1300; ++p) {  // each needs its own table
    SymbolCounts counts{};
    for (int k = 0; k < 12; ++k) counts[random() % 256] += 100000;
    planes.push_back(counts);
  }
  for (std::uint32_t s = 0; s < 256; ++s) {
    planes.emplace_back();
    planes.back()[s] = 1;
  }
  const TablePlan plan = plan_tables(planes);
  CHECK(plan.tables.size() <= kMaxTables);
  CHECK(plan.tables.size() > kMaxTables / 2);
  CHECK(std::isfinite(bits_of(planes, plan)));
}

TEST_CASE("digits represent every value, and cost close to the entropy of the values") {
  std::mt19937 random(8);
  // Values of up to 20 bits, most of them within the lowest 12.
  std::vector<std::uint32_t> values(20000);
  std::exponential_distribution<double> size(1.0 / 4000.0);
  for (std::uint32_t& v : values) v = static_cast<std::uint32_t>(size(random));
  values[77] = 0xFFFFF;
  const Integers integers = integers_of(values);
  const Integers* const records[] = {&integers};
  for (const Coder coder : {Coder::kRans, Coder::kBytes}) {
    const StreamPlan plan = plan_stream(records, coder);
    CHECK(static_cast<Coder>(plan.row.coder) == coder);
    CHECK(static_cast<Prediction>(plan.row.prediction) == Prediction::kPlain);
    std::vector<std::uint8_t> planes;
    append_planes(integers, plan, planes);
    REQUIRE(planes.size() == plan.row.planes() * values.size());
    const std::uint32_t minimum = *std::min_element(values.begin(), values.end());
    std::vector<std::uint32_t> expected = values;
    for (std::uint32_t& v : expected) v -= minimum;
    CHECK(values_of(plan.row, planes, values.size()) == expected);
    CHECK(plan.row.origin[0] == std::ldexp(static_cast<float>(minimum), -2));
    if (coder == Coder::kBytes) continue;
    // Within a tenth of a bit of the distribution's entropy, log2(e 4000).
    double bits = 0.0;
    for (std::size_t d = 0; d < plan.row.digits; ++d) {
      SymbolCounts counts{};
      for (std::size_t i = 0; i < values.size(); ++i) ++counts[planes[d * values.size() + i]];
      bits += rans_cost(rans_table(counts), counts);
    }
    CHECK(bits / static_cast<double>(values.size()) < 13.41 + 0.1);
  }
}

TEST_CASE("slowly changing values are stored as differences") {
  std::vector<std::uint32_t> values(5000);
  std::mt19937 random(9);
  std::uint32_t v = 100000;
  for (std::uint32_t& value : values) {
    v += static_cast<std::uint32_t>(random() % 7) - 3;
    value = v;
  }
  const Integers integers = integers_of(values);
  const Integers* const records[] = {&integers};
  const StreamPlan plan = plan_stream(records, Coder::kRans);
  CHECK(static_cast<Prediction>(plan.row.prediction) == Prediction::kDelta);
}

TEST_CASE("few primitives are stored without tables") {
  std::vector<std::uint32_t> values(20);
  std::mt19937 random(10);
  for (std::uint32_t& value : values) value = static_cast<std::uint32_t>(random() % 256);
  const Integers integers = integers_of(values);
  const Integers* const records[] = {&integers};
  CHECK(static_cast<Coder>(plan_stream(records, Coder::kRans).row.coder) == Coder::kBytes);
}
