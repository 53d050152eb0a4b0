// SPDX-License-Identifier: Apache-2.0
#include "geometry/plane_sweep.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/plane_sweep_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#include "geometry/grey_vector-inl.h"
#include "geometry/sweep_rule.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

constexpr int kLanes = static_cast<int>(hn::MaxLanes(GreyTag()));

// Repeats the values at the ends of a row in its margins.
void extend(float* row, int width, int margin) {
  for (int k = 1; k <= margin; ++k) {
    row[-k] = row[0];
    row[width - 1 + k] = row[width - 1];
  }
}

// The values of a source at the pixels of a row of the reference, and 1 where they are seen.
void warp_row(const SweepSource& source, const float (&h)[9], Columns columns, int y, float* values,
              float* seen) {
  const GreyTag d;
  const hn::RebindToSigned<GreyTag> di;
  const hn::RebindToUnsigned<GreyTag> du;
  const float v = static_cast<float>(y);
  const GreyV half = hn::Set(d, 0.5f), zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const GreyImage<GreyTag> image(source.corners, source.width, source.height);
  const GreyV last_x = hn::Set(d, static_cast<float>(source.width) - 0.5f);
  const GreyV last_y = hn::Set(d, static_cast<float>(source.height) - 0.5f);
  for (int x = columns.first; x < columns.last; x += kLanes) {
    const GreyV u = hn::Add(hn::Iota(d, 0), hn::Set(d, static_cast<float>(x)));
    const GreyV z = hn::MulAdd(hn::Set(d, h[6]), u, hn::Set(d, h[7] * v + h[8]));
    const GreyV unit = hn::Div(one, hn::Max(z, hn::Set(d, 1e-9f)));
    const GreyV su = hn::Mul(hn::MulAdd(hn::Set(d, h[0]), u, hn::Set(d, h[1] * v + h[2])), unit);
    const GreyV sv = hn::Mul(hn::MulAdd(hn::Set(d, h[3]), u, hn::Set(d, h[4] * v + h[5])), unit);
    hn::StoreU(image.at(su, sv), d, values + x);
    auto inside = hn::And(hn::Gt(z, zero), hn::And(hn::Ge(su, hn::Neg(half)), hn::Lt(su, last_x)));
    inside = hn::And(inside, hn::And(hn::Ge(sv, hn::Neg(half)), hn::Lt(sv, last_y)));
    if (source.usable != nullptr) {
      const auto nearest = [&](GreyV at, int size) {
        const auto pixel = hn::ConvertTo(di, hn::IfThenElseZero(inside, hn::Add(at, half)));
        return hn::Min(pixel, hn::Set(di, size - 1));  // the sum can be rounded up
      };
      const auto px = nearest(su, source.width), py = nearest(sv, source.height);
      const auto index = hn::Add(hn::Mul(py, hn::Set(di, source.width)), px);
      const auto usable = hn::Ne(hn::GatherIndex(du, source.usable, index), hn::Zero(du));
      inside = hn::And(inside, hn::RebindMask(d, usable));
    }
    hn::StoreU(hn::IfThenElseZero(inside, one), d, seen + x);
  }
}

// The sum over `window` values around each entry of a row.
HWY_INLINE GreyV across(const float* row, int x, int reach) {
  const GreyTag d;
  GreyV sum = hn::LoadU(d, row + x);
  for (int k = 1; k <= reach; ++k)
    sum = hn::Add(sum, hn::Add(hn::LoadU(d, row + x - k), hn::LoadU(d, row + x + k)));
  return sum;
}

// Rows of sums in the reference's pitch, with a margin for windows on both sides.
class Sums {
 public:
  Sums(const SweepReference& reference, int count, std::vector<float>* memory)
      : reach_(reference.window / 2),
        pitch_(reference.pitch + 2 * reach_),
        width_(reference.width),
        count_(count),
        values_(*memory) {
    values_.resize(static_cast<std::size_t>(pitch_) * count);
  }
  float* row(int k) { return values_.data() + static_cast<std::ptrdiff_t>(k) * pitch_ + reach_; }
  void extend_all() {
    for (int k = 0; k < count_; ++k) extend(row(k), width_, reach_);
  }
  // The mean over the windows around the entries of row k from x on.
  HWY_INLINE GreyV mean(int k, int x) {
    const GreyV share =
        hn::Set(GreyTag(), 1.0f / static_cast<float>((2 * reach_ + 1) * (2 * reach_ + 1)));
    return hn::Mul(across(row(k), x, reach_), share);
  }

 private:
  int reach_, pitch_, width_, count_;
  std::vector<float>& values_;
};

// The row of an array in the reference's pitch, the nearest one if it is outside.
template <class Values>
auto row_of(const SweepReference& reference, Values& values, int y) {
  const int row = std::clamp(y, 0, reference.height - 1);
  return values.data() + static_cast<std::ptrdiff_t>(row) * reference.pitch;
}

void find_statistics(SweepReference& reference) {
  const GreyTag d;
  const int reach = reference.window / 2;
  std::vector<float> memory;
  Sums sums(reference, 2, &memory);
  for (int y = 0; y < reference.height; ++y) {
    for (int x = 0; x < reference.pitch; x += kLanes) {
      GreyV a = hn::Zero(d), aa = a;
      for (int k = -reach; k <= reach; ++k) {
        const GreyV value = hn::LoadU(d, row_of(reference, reference.grey, y + k) + x);
        a = hn::Add(a, value);
        aa = hn::MulAdd(value, value, aa);
      }
      hn::StoreU(a, d, sums.row(0) + x);
      hn::StoreU(aa, d, sums.row(1) + x);
    }
    sums.extend_all();
    for (int x = 0; x < reference.pitch; x += kLanes) {
      const GreyV mean = sums.mean(0, x);
      hn::StoreU(mean, d, row_of(reference, reference.mean, y) + x);
      hn::StoreU(hn::Max(hn::NegMulAdd(mean, mean, sums.mean(1, x)), hn::Zero(d)), d,
                 row_of(reference, reference.variance, y) + x);
    }
  }
}

// Inputs of a cost, for the pixels of one vector.
struct Windows {
  GreyV a, mean_a, variance_a;         // the reference
  GreyV b, mean_b, square_b, product;  // the source
};

HWY_INLINE GreyV cost_of(const Windows& w) {
  const GreyTag d;
  const GreyV one = hn::Set(d, 1.0f), floor = hn::Set(d, kSweepTextureFloor);
  const GreyV variance_b = hn::Max(hn::NegMulAdd(w.mean_b, w.mean_b, w.square_b), hn::Zero(d));
  const GreyV spread = hn::Mul(hn::Add(w.variance_a, floor), hn::Add(variance_b, floor));
  const GreyV covariance = hn::NegMulAdd(w.mean_a, w.mean_b, w.product);
  const GreyV correlation = hn::Div(covariance, hn::Sqrt(spread));
  const GreyV colour = hn::Mul(hn::Set(d, 0.5f / kColourScale),
                               hn::Add(hn::AbsDiff(w.mean_a, w.mean_b), hn::AbsDiff(w.a, w.b)));
  const GreyV value =
      hn::MulAdd(hn::Set(d, 1.0f - kColourShare), hn::Min(one, hn::Sub(one, correlation)),
                 hn::Mul(hn::Set(d, kColourShare), hn::Min(one, colour)));
  return hn::Min(hn::Max(value, hn::Zero(d)), one);
}

// Updates the two smallest costs, and the number of views, with a cost that is valid where seen.
HWY_INLINE void update(GreyV cost, GreyV seen, float* first, float* second, float* total) {
  const GreyTag d;
  const GreyV value = hn::IfThenElse(hn::Gt(seen, hn::Zero(d)), cost, hn::Set(d, 1.0f));
  const GreyV best = hn::LoadU(d, first);
  hn::StoreU(hn::Min(hn::LoadU(d, second), hn::Max(best, value)), d, second);
  hn::StoreU(hn::Min(best, value), d, first);
  hn::StoreU(hn::Add(hn::LoadU(d, total), seen), d, total);
}

void compare(const SweepReference& reference, const SweepSource& source, const float (&h)[9],
             PlaneCosts& costs) {
  const GreyTag d;
  const int reach = reference.window / 2;
  Sums sums(reference, 3, &costs.sums);
  for (int y = 0; y < reference.height; ++y)
    warp_row(source, h, reference.samples[y], y, row_of(reference, costs.warped, y),
             row_of(reference, costs.visible, y));
  for (int y = 0; y < reference.height; ++y) {
    for (int x = reference.sums[y].first; x < reference.sums[y].last; x += kLanes) {
      GreyV b = hn::Zero(d), bb = b, ab = b;
      for (int k = -reach; k <= reach; ++k) {
        const GreyV value = hn::LoadU(d, row_of(reference, costs.warped, y + k) + x);
        b = hn::Add(b, value);
        bb = hn::MulAdd(value, value, bb);
        ab = hn::MulAdd(value, hn::LoadU(d, row_of(reference, reference.grey, y + k) + x), ab);
      }
      hn::StoreU(b, d, sums.row(0) + x);
      hn::StoreU(bb, d, sums.row(1) + x);
      hn::StoreU(ab, d, sums.row(2) + x);
    }
    sums.extend_all();
    const auto load = [&](auto& values, int x) {
      return hn::LoadU(d, row_of(reference, values, y) + x);
    };
    for (int x = reference.costs[y].first; x < reference.costs[y].last; x += kLanes) {
      const Windows windows{
          load(reference.grey, x), load(reference.mean, x), load(reference.variance, x),
          load(costs.warped, x),   sums.mean(0, x),         sums.mean(1, x),
          sums.mean(2, x)};
      update(cost_of(windows), load(costs.visible, x), row_of(reference, costs.first, y) + x,
             row_of(reference, costs.second, y) + x, row_of(reference, costs.seen, y) + x);
    }
  }
}

// Writes volume_cost() of a row, up to a whole vector.
void round_row(const float* first, const float* second, const float* seen, int width,
               std::uint8_t* out) {
  const GreyTag d;
  const hn::RebindToSigned<GreyTag> di;
  const hn::Rebind<std::uint8_t, GreyTag> d8;
  const GreyV half = hn::Set(d, 0.5f);
  for (int x = 0; x < width; x += kLanes) {
    const GreyV best = hn::LoadU(d, first + x);
    const GreyV mean = hn::Mul(half, hn::Add(best, hn::LoadU(d, second + x)));
    const auto has_three = hn::Gt(hn::LoadU(d, seen + x), hn::Set(d, 2.5f));
    const GreyV cost = hn::IfThenElse(has_three, mean, best);
    const auto level = hn::ConvertTo(di, hn::MulAdd(cost, hn::Set(d, 254.0f), half));
    hn::StoreU(hn::DemoteTo(d8, level), d8, out + x);
  }
}

void round_costs(const SweepReference& reference, const PlaneCosts& costs, std::uint8_t* out) {
  std::vector<std::uint8_t> row(static_cast<std::size_t>(reference.pitch));
  for (int y = 0; y < reference.height; ++y, out += reference.width) {
    round_row(row_of(reference, costs.first, y), row_of(reference, costs.second, y),
              row_of(reference, costs.seen, y), reference.pitch, row.data());
    std::copy_n(row.data(), reference.width, out);
  }
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(find_statistics);
HWY_EXPORT(compare);
HWY_EXPORT(round_costs);

namespace {

constexpr int kMaxLanes = 16;

// Returns the whole vectors that hold the columns, of those within the pitch.
Columns whole_vectors(Columns columns, int pitch) {
  if (columns.first >= columns.last) return {0, 0};
  return {std::max(columns.first, 0) / kMaxLanes * kMaxLanes,
          std::min((columns.last + kMaxLanes - 1) / kMaxLanes * kMaxLanes, pitch)};
}

// Returns the columns from the first to the last pixel whose mask is not 0.
Columns masked_columns(const std::uint8_t* row, int width) {
  Columns out{0, width};
  while (out.first < width && row[out.first] == 0) ++out.first;
  while (out.last > out.first && row[out.last - 1] == 0) --out.last;
  return out;
}

void set_columns(const std::uint8_t* mask, std::ptrdiff_t step, SweepReference& reference) {
  const int reach = reference.window / 2, height = reference.height;
  std::vector<Columns> windows;  // of the wanted pixels
  for (int y = 0; y < height; ++y) {
    Columns wanted{0, reference.width};
    if (mask != nullptr) wanted = masked_columns(mask + y * step, reference.width);
    reference.costs.push_back(whole_vectors(wanted, reference.pitch));
    const bool is_empty = wanted.first >= wanted.last;
    windows.push_back(is_empty ? Columns{0, 0}
                               : Columns{wanted.first - reach, wanted.last + reach});
    reference.sums.push_back(whole_vectors(windows.back(), reference.pitch));
  }
  for (int y = 0; y < height; ++y) {
    Columns all{reference.width, 0};
    for (int k = std::max(y - reach, 0); k <= std::min(y + reach, height - 1); ++k) {
      if (windows[k].first >= windows[k].last) continue;
      all = {std::min(all.first, windows[k].first), std::max(all.last, windows[k].last)};
    }
    reference.samples.push_back(whole_vectors(all, reference.pitch));
  }
}

}  // namespace

SweepReference make_sweep_reference(const std::vector<float>& grey, int width, int height,
                                    int window, const std::uint8_t* mask, std::ptrdiff_t step) {
  SweepReference out;
  out.width = width;
  out.height = height;
  out.pitch = (width + kMaxLanes - 1) / kMaxLanes * kMaxLanes;
  out.window = window;
  const std::size_t size = static_cast<std::size_t>(out.pitch) * height;
  out.grey.resize(size);
  out.mean.resize(size);
  out.variance.resize(size);
  for (int y = 0; y < height; ++y)
    std::copy_n(grey.data() + static_cast<std::ptrdiff_t>(y) * width, width,
                out.grey.data() + static_cast<std::ptrdiff_t>(y) * out.pitch);
  set_columns(mask, step, out);
  HWY_DYNAMIC_DISPATCH(find_statistics)(out);
  return out;
}

void reset(const SweepReference& reference, PlaneCosts* costs) {
  costs->first.assign(reference.grey.size(), 1.0f);
  costs->second.assign(reference.grey.size(), 1.0f);
  costs->seen.assign(reference.grey.size(), 0.0f);
  costs->warped.resize(reference.grey.size());
  costs->visible.resize(reference.grey.size());
}

void add_source(const SweepReference& reference, const SweepSource& source, const float (&h)[9],
                PlaneCosts* costs) {
  HWY_DYNAMIC_DISPATCH(compare)(reference, source, h, *costs);
}

void volume_costs(const SweepReference& reference, const PlaneCosts& costs, std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(round_costs)(reference, costs, out);
}

}  // namespace stgs::encoder::geometry
#endif
