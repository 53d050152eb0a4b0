// SPDX-License-Identifier: Apache-2.0
// Clauses 6.2 to 6.5 and the limits of 7.2 to 7.5: layouts and their streams.
#include "interchange/stgs1/layouts.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stgs::stgs1 {
namespace {

constexpr std::uint64_t kRowMemory = 128, kFreeRows = 1024;  // conformance 1.5
constexpr std::size_t kMaxLayouts = 65534, kMaxGroup = 256;  // 6.2, A.1
constexpr int kMappings = 8, kPredictions = 4, kCoders = 3;

struct Name {
  const char* name;
  int components;
};
constexpr Name kAttributes[] = {{"", 0},        {"position", 3}, {"time", 1},      {"sigma", 1},
                                {"radius", 1},  {"velocity", 3}, {"log_scale", 3}, {"rotation", 4},
                                {"opacity", 1}, {"sh0", 3},      {"sh1", 9},       {"sh2", 15},
                                {"sh3", 21}};

bool is_sh(std::uint16_t attribute) {
  return attribute >= kSh0 && attribute <= kSh3;
}

// Returns whether an attribute may have a mapping (7.5.1 to 7.5.8).
bool may_have(std::uint16_t attribute, int mapping) {
  switch (mapping) {
    case 0:
      return true;
    case 1:
      return attribute == kPosition || attribute == kTime || attribute == kLogScale ||
             attribute == kOpacity || is_sh(attribute);
    case 2:
      return attribute == kSigma || attribute == kRadius;
    case 3:
      return attribute == kVelocity;
    case 4:
    case 6:
      return attribute == kRotation;
    case 5:
      return is_sh(attribute);
    default:
      return attribute == kTime;
  }
}

bool is_origin(float v) {  // 7.5
  return v == 0.0f || (std::abs(v) >= 0x1p-100f && std::abs(v) <= 0x1p100f);
}

// Returns the rule that the fields of a known stream break, or null.
const char* broken_rule(const Stream& s) {
  const int bits = std::accumulate(s.bits.begin(), s.bits.end(), 0);
  const auto all_bits = [&s](int low, int high) {
    return std::all_of(s.bits.begin(), s.bits.end(), [=](int b) { return b >= low && b <= high; });
  };
  if (!all_bits(1, 8) || (s.coder != kRans && !all_bits(8, 8))) return "the bits of a digit";
  if (s.coder == kDraco &&
      (s.attribute != kPosition || s.mapping != 1 || s.prediction != 0 || s.bits.size() != 3)) {
    return "a stream that Draco cannot code";
  }
  if (bits > (s.prediction == kMorton ? 64 : 32)) return "the bits of a value";
  if (!may_have(s.attribute, s.mapping)) return "the mapping of another attribute";
  if (s.mapping == 0 && (s.prediction != 0 || s.exponent != 0 || s.multiplier != 1)) {
    return "floats with a prediction or a step";
  }
  const bool is_rotation = s.mapping == 4 || s.mapping == 6;
  const int low = is_rotation ? -14 : s.mapping == 2 ? 0 : -100;
  const int high = is_rotation ? -1 : s.mapping == 2 ? 23 : 100;
  if (s.multiplier % 2 != 1 || s.exponent < low || s.exponent > high) return "the step";
  if (!std::all_of(s.origin.begin(), s.origin.end(), is_origin)) return "the origin";
  if (s.mapping == 2 && s.origin[0] < 0x1p-100f) return "the origin";
  if (s.prediction == kMorton && (s.attribute != kPosition || s.mapping != 1)) {
    return "the prediction";
  }
  const int components = s.prediction == kMorton ? 1 : is_rotation ? 3 : components_of(s.attribute);
  return s.components == components ? nullptr : "the components";
}

// Reads the fields after the coder (6.3).
Status read_known(ByteReader& row, std::size_t tables, Stream& s) {
  s.exponent = row.i8();
  s.multiplier = row.u8();
  const int digits = row.u8(), numbers = row.u8();
  if (!row.ok() || digits < 1 || digits > 16 || numbers > 3) {
    return invalid_file("a row of its layout is truncated, or has an invalid count");
  }
  for (int i = 0; i < digits; ++i) s.bits.push_back(row.u8());
  for (int i = 0; i < numbers; ++i) s.origin[static_cast<std::size_t>(i)] = row.f32();
  if (s.coder == kRans) {
    for (std::size_t i = 0; i < s.planes() && row.ok(); ++i) s.tables.push_back(row.u16());
  }
  const bool has_tables = std::all_of(s.tables.begin(), s.tables.end(),
                                      [tables](std::uint16_t t) { return t < tables; });
  if (!row.ok() || !has_tables) {
    return invalid_file("a row of its layout is truncated, or names a missing table");
  }
  const char* const problem = broken_rule(s);
  if (problem == nullptr) return {};
  return invalid_file("its layout breaks a rule for {}: {}", name_of(s.attribute), problem);
}

Status read_stream(View bytes, std::size_t tables, Stream& s) {
  ByteReader row(bytes);
  s.attribute = row.u16();
  s.components = row.u8();
  s.mapping = row.u8();
  s.prediction = row.u8();
  s.coder = row.u8();
  if (!row.ok()) return invalid_file("a row of its layout is truncated");
  if (s.is_optional()) {  // 6.5
    if (s.coder == kRans) return invalid_file("an optional attribute is coded by rANS");
    return {};
  }
  s.known = components_of(s.attribute) > 0 && s.mapping < kMappings &&
            s.prediction < kPredictions && s.coder < kCoders;
  return s.known ? read_known(row, tables, s) : Status();
}

// Checks the planes of all streams (7.3, A.1).
Status check_planes(std::span<const Stream> streams, const std::vector<Table>& tables) {
  std::size_t planes = 0, group = 0, float_bytes = 0;
  for (const Stream& s : streams) {
    planes += s.planes();
    if (s.known) float_bytes += 4 * static_cast<std::size_t>(components_of(s.attribute));
    group += static_cast<std::size_t>(
        std::count_if(s.tables.begin(), s.tables.end(),
                      [&tables](std::uint16_t t) { return !tables[t].is_single; }));
  }
  if (planes <= float_bytes && group <= kMaxGroup) return {};
  return invalid_file("its layout has too many planes ({}, {} of them coded by rANS)", planes,
                      group);
}

}  // namespace

int components_of(std::uint16_t attribute) {
  return attribute <= kSh3 ? kAttributes[attribute].components : 0;
}

const char* name_of(std::uint16_t attribute) {
  return attribute <= kSh3 ? kAttributes[attribute].name : "";
}

Status read_layouts(ByteReader& in, ImportMemory& memory, std::size_t max_tables, LayoutSet& out,
                    Lease& lease) {
  const std::size_t tables = in.u16();
  if (tables > max_tables) {
    return invalid_file("too many tables (expected at most {}, got {})", max_tables, tables);
  }
  STGS_TRY(memory.grow(lease, kTableMemory * tables, "the tables of a layout"));
  for (std::size_t i = 0; i < tables; ++i) STGS_TRY(read_table(in, out.tables.emplace_back()));
  const std::size_t layouts = in.u16();
  if (!in.ok() || layouts > kMaxLayouts) return invalid_file("the layouts are truncated");
  std::uint64_t rows = 0;
  for (std::size_t i = 0; i < layouts && in.ok(); ++i) {
    const int count = in.u8();
    rows += static_cast<std::uint64_t>(count);
    if (rows > kFreeRows) {
      STGS_TRY(memory.grow(lease, kTableMemory * tables + kRowMemory * (rows - kFreeRows),
                           "the rows of layouts"));
    }
    Status problem;
    for (int r = 0; r < count; ++r) {
      const View row = in.bytes(in.u16());
      if (!in.ok()) return invalid_file("the layouts are truncated");
      if (problem.ok()) problem = read_stream(row, tables, out.rows.emplace_back());
    }
    out.ends.push_back(static_cast<std::uint32_t>(out.rows.size()));
    if (problem.ok()) problem = check_planes(out.streams(i), out.tables);
    if (!problem.ok()) out.problems.emplace(i, std::move(problem));
  }
  return in.ok() ? Status() : invalid_file("the layouts are truncated");
}

}  // namespace stgs::stgs1
