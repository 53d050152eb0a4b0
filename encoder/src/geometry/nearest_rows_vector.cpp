// SPDX-License-Identifier: Apache-2.0
#include "geometry/nearest_rows.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/nearest_rows_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using RowTag = hn::CappedTag<float, 16>;
using RowV = hn::Vec<RowTag>;

constexpr int kRowLanes = static_cast<int>(hn::MaxLanes(RowTag()));
constexpr int kBlock = 4;  // rows of a that share the loads of b

// The nearest rows so far, one search per lane.
struct Searches {
  HWY_ALIGN float index[kRowLanes], first[kRowLanes], second[kRowLanes];

  Searches() {
    std::fill_n(index, kRowLanes, -1.0f);
    std::fill_n(first, kRowLanes, NearestRow().first);
    std::fill_n(second, kRowLanes, NearestRow().second);
  }

  HWY_INLINE void take(RowV squared, RowV row) {
    const RowTag d;
    const RowV least = hn::Load(d, first);
    const auto is_nearer = hn::Lt(squared, least);
    const RowV next = hn::Min(hn::Load(d, second), squared);
    hn::Store(hn::IfThenElse(is_nearer, least, next), d, second);
    hn::Store(hn::Min(squared, least), d, first);
    hn::Store(hn::IfThenElse(is_nearer, row, hn::Load(d, index)), d, index);
  }

  NearestRow of_lane(int k) const { return {static_cast<int>(index[k]), first[k], second[k]}; }

  // Returns the nearest of all lanes.
  NearestRow of_all() const {
    NearestRow out;
    for (int k = 0; k < kRowLanes; ++k) {
      const NearestRow other = of_lane(k);
      const bool is_nearer =
          other.first < out.first || (other.first == out.first && other.index < out.index);
      const float farther = is_nearer ? out.first : other.first;
      out.second = std::min({out.second, other.second, farther});
      if (!is_nearer) continue;
      out.first = other.first;
      out.index = other.index;
    }
    return out;
  }
};

float squared_length(const Rows& rows, int row) {
  const float* values = rows.values + static_cast<std::ptrdiff_t>(row) * rows.columns;
  return std::inner_product(values, values + rows.columns, values, 0.0f);
}

// As many rows of b as there are lanes, transposed. Rows after the last are too far to be found.
class Panel {
 public:
  Panel(const Rows& b, int from, std::vector<float>& memory) : columns_(b.columns), from_(from) {
    memory.assign(static_cast<std::size_t>(b.columns) * kRowLanes, 0.0f);
    for (int k = 0; k < kRowLanes; ++k) {
      lengths_[k] = 2e30f;
      if (from + k >= b.count) continue;
      lengths_[k] = squared_length(b, from + k);
      for (int c = 0; c < b.columns; ++c)
        memory[static_cast<std::size_t>(c) * kRowLanes + k] =
            b.values[static_cast<std::ptrdiff_t>(from + k) * b.columns + c];
    }
    values_ = memory.data();
  }

  // Compares `kRows` rows of a, from `i` on.
  template <int kRows>
  void compare(const Rows& a, const float* lengths, int i, Searches* to_b, Searches& to_a) const {
    const RowTag d;
    RowV product[kRows];
    for (int r = 0; r < kRows; ++r) product[r] = hn::Zero(d);
    const float* row = a.values + static_cast<std::ptrdiff_t>(i) * columns_;
    for (int c = 0; c < columns_; ++c) {
      const RowV b = hn::LoadU(d, values_ + static_cast<std::ptrdiff_t>(c) * kRowLanes);
      for (int r = 0; r < kRows; ++r)
        product[r] = hn::MulAdd(hn::Set(d, row[r * columns_ + c]), b, product[r]);
    }
    const RowV other = hn::Add(hn::Iota(d, 0), hn::Set(d, static_cast<float>(from_)));
    for (int r = 0; r < kRows; ++r) {
      const RowV sum = hn::Add(hn::Set(d, lengths[i + r]), hn::Load(d, lengths_));
      const RowV squared = hn::Max(hn::NegMulAdd(hn::Set(d, 2.0f), product[r], sum), hn::Zero(d));
      to_b[i + r].take(squared, other);
      to_a.take(squared, hn::Set(d, static_cast<float>(i + r)));
    }
  }

 private:
  const float* values_;
  int columns_, from_;
  HWY_ALIGN float lengths_[kRowLanes];
};

void find(const Rows& a, const Rows& b, NearestRows& out) {
  std::vector<float> lengths, memory;
  for (int i = 0; i < a.count; ++i) lengths.push_back(squared_length(a, i));
  std::vector<Searches> to_b(static_cast<std::size_t>(a.count));
  for (int from = 0; from < b.count; from += kRowLanes) {
    const Panel panel(b, from, memory);
    Searches to_a;
    int i = 0;
    for (; i + kBlock <= a.count; i += kBlock)
      panel.compare<kBlock>(a, lengths.data(), i, to_b.data(), to_a);
    for (; i < a.count; ++i) panel.compare<1>(a, lengths.data(), i, to_b.data(), to_a);
    for (int k = 0; k < std::min(kRowLanes, b.count - from); ++k)
      out.to_a.push_back(to_a.of_lane(k));
  }
  for (const Searches& searches : to_b) out.to_b.push_back(searches.of_all());
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(find);

NearestRows find_nearest_rows(const Rows& a, const Rows& b) {
  NearestRows out;
  HWY_DYNAMIC_DISPATCH(find)(a, b, out);
  return out;
}

}  // namespace stgs::encoder::geometry
#endif
