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

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

constexpr float kTextureFloor = 6.0f;  // variance (grey levels^2) of texture too weak to correlate
constexpr float kColourScale = 48.0f;  // colour difference with the maximum cost, grey levels
constexpr float kColourShare = 0.35f;  // weight of the colour term in the cost

constexpr int kLanes = static_cast<int>(hn::MaxLanes(GreyTag()));

// Rows of values that vectors may read and write beyond the width, with a margin on the left.
class Rows {
 public:
  Rows(int width, int height, int margin)
      : margin_(margin),
        pitch_(width + 2 * margin + kLanes),
        values_(static_cast<std::size_t>(pitch_) * height) {}
  float* at(int y) { return values_.data() + static_cast<std::ptrdiff_t>(y) * pitch_ + margin_; }

 private:
  int margin_, pitch_;
  std::vector<float> values_;
};

// Repeats the values at the ends of a row in its margins.
void extend(float* row, int width, int margin) {
  for (int k = 1; k <= margin; ++k) {
    row[-k] = row[0];
    row[width - 1 + k] = row[width - 1];
  }
}

// The values of a source at the pixels of a row of the reference, and 1 where they are seen.
void warp_row(const SweepSource& source, const float (&h)[9], int width, int y, float* values,
              float* seen) {
  const GreyTag d;
  const hn::RebindToSigned<GreyTag> di;
  const hn::RebindToUnsigned<GreyTag> du;
  const float v = static_cast<float>(y);
  const GreyV half = hn::Set(d, 0.5f), zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const GreyV last_x = hn::Set(d, static_cast<float>(source.width) - 0.5f);
  const GreyV last_y = hn::Set(d, static_cast<float>(source.height) - 0.5f);
  for (int x = 0; x < width; x += kLanes) {
    const GreyV u = hn::Add(hn::Iota(d, 0), hn::Set(d, static_cast<float>(x)));
    const GreyV z = hn::MulAdd(hn::Set(d, h[6]), u, hn::Set(d, h[7] * v + h[8]));
    const GreyV unit = hn::Div(one, hn::Max(z, hn::Set(d, 1e-9f)));
    const GreyV su = hn::Mul(hn::MulAdd(hn::Set(d, h[0]), u, hn::Set(d, h[1] * v + h[2])), unit);
    const GreyV sv = hn::Mul(hn::MulAdd(hn::Set(d, h[3]), u, hn::Set(d, h[4] * v + h[5])), unit);
    hn::StoreU(grey_vector(source.corners, source.width, source.height, su, sv), d, values + x);
    auto inside = hn::And(hn::Gt(z, zero), hn::And(hn::Ge(su, hn::Neg(half)), hn::Lt(su, last_x)));
    inside = hn::And(inside, hn::And(hn::Ge(sv, hn::Neg(half)), hn::Lt(sv, last_y)));
    if (source.usable != nullptr) {
      const auto px = hn::ConvertTo(di, hn::IfThenElseZero(inside, hn::Add(su, half)));
      const auto py = hn::ConvertTo(di, hn::IfThenElseZero(inside, hn::Add(sv, half)));
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

void find_statistics(SweepReference& reference) {
  const GreyTag d;
  const int width = reference.width, height = reference.height, reach = reference.window / 2;
  const GreyV share = hn::Set(d, 1.0f / static_cast<float>(reference.window * reference.window));
  Rows grey(width, height, 0), sums(width, 2, reach), out(width, 2, 0);
  for (int y = 0; y < height; ++y)
    std::copy_n(reference.grey.data() + static_cast<std::ptrdiff_t>(y) * width, width, grey.at(y));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; x += kLanes) {
      GreyV a = hn::Zero(d), aa = a;
      for (int k = -reach; k <= reach; ++k) {
        const GreyV value = hn::LoadU(d, grey.at(std::clamp(y + k, 0, height - 1)) + x);
        a = hn::Add(a, value);
        aa = hn::MulAdd(value, value, aa);
      }
      hn::StoreU(a, d, sums.at(0) + x);
      hn::StoreU(aa, d, sums.at(1) + x);
    }
    extend(sums.at(0), width, reach);
    extend(sums.at(1), width, reach);
    for (int x = 0; x < width; x += kLanes) {
      const GreyV mean = hn::Mul(across(sums.at(0), x, reach), share);
      const GreyV square = hn::Mul(across(sums.at(1), x, reach), share);
      hn::StoreU(mean, d, out.at(0) + x);
      hn::StoreU(hn::Max(hn::NegMulAdd(mean, mean, square), hn::Zero(d)), d, out.at(1) + x);
    }
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * width;
    std::copy_n(out.at(0), width, reference.mean.data() + at);
    std::copy_n(out.at(1), width, reference.variance.data() + at);
  }
}

// What a cost is computed from, at the pixels of one vector.
struct Windows {
  GreyV a, mean_a, variance_a;         // the reference
  GreyV b, mean_b, square_b, product;  // the source
};

HWY_INLINE GreyV cost_of(const Windows& w) {
  const GreyTag d;
  const GreyV one = hn::Set(d, 1.0f), floor = hn::Set(d, kTextureFloor);
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

// Updates the costs of `count` pixels, at most a vector, with one that is valid where seen.
HWY_INLINE void update(GreyV cost, GreyV seen, std::size_t count, float* first, float* second,
                       float* total) {
  const GreyTag d;
  const GreyV value = hn::IfThenElse(hn::Gt(seen, hn::Zero(d)), cost, hn::Set(d, 1.0f));
  const auto load = [&](const float* p) {
    return count == static_cast<std::size_t>(kLanes) ? hn::LoadU(d, p)
                                                     : hn::MaskedLoad(hn::FirstN(d, count), d, p);
  };
  const auto store = [&](GreyV v, float* p) {
    if (count == static_cast<std::size_t>(kLanes)) {
      hn::StoreU(v, d, p);
    } else {
      hn::BlendedStore(v, hn::FirstN(d, count), d, p);
    }
  };
  const GreyV best = load(first);
  store(hn::Min(load(second), hn::Max(best, value)), second);
  store(hn::Min(best, value), first);
  store(hn::Add(load(total), seen), total);
}

void compare(const SweepReference& reference, const SweepSource& source, const float (&h)[9],
             PlaneCosts& costs) {
  const GreyTag d;
  const int width = reference.width, height = reference.height, reach = reference.window / 2;
  const GreyV share = hn::Set(d, 1.0f / static_cast<float>(reference.window * reference.window));
  Rows warped(width, height, 0), seen(width, height, 0), grey(width, height, 0);
  Rows sums(width, 3, reach), statistics(width, 2, 0);
  for (int y = 0; y < height; ++y) {
    warp_row(source, h, width, y, warped.at(y), seen.at(y));
    std::copy_n(reference.grey.data() + static_cast<std::ptrdiff_t>(y) * width, width, grey.at(y));
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; x += kLanes) {
      GreyV b = hn::Zero(d), bb = b, ab = b;
      for (int k = -reach; k <= reach; ++k) {
        const int row = std::clamp(y + k, 0, height - 1);
        const GreyV value = hn::LoadU(d, warped.at(row) + x);
        b = hn::Add(b, value);
        bb = hn::MulAdd(value, value, bb);
        ab = hn::MulAdd(value, hn::LoadU(d, grey.at(row) + x), ab);
      }
      hn::StoreU(b, d, sums.at(0) + x);
      hn::StoreU(bb, d, sums.at(1) + x);
      hn::StoreU(ab, d, sums.at(2) + x);
    }
    for (int k = 0; k < 3; ++k) extend(sums.at(k), width, reach);
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * width;
    std::copy_n(reference.mean.data() + at, width, statistics.at(0));
    std::copy_n(reference.variance.data() + at, width, statistics.at(1));
    for (int x = 0; x < width; x += kLanes) {
      const Windows windows{hn::LoadU(d, grey.at(y) + x),
                            hn::LoadU(d, statistics.at(0) + x),
                            hn::LoadU(d, statistics.at(1) + x),
                            hn::LoadU(d, warped.at(y) + x),
                            hn::Mul(across(sums.at(0), x, reach), share),
                            hn::Mul(across(sums.at(1), x, reach), share),
                            hn::Mul(across(sums.at(2), x, reach), share)};
      const auto count = static_cast<std::size_t>(std::min(kLanes, width - x));
      update(cost_of(windows), hn::LoadU(d, seen.at(y) + x), count, costs.first.data() + at + x,
             costs.second.data() + at + x, costs.seen.data() + at + x);
    }
  }
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(find_statistics);
HWY_EXPORT(compare);

SweepReference make_sweep_reference(std::vector<float> grey, int width, int height, int window) {
  SweepReference out;
  out.width = width;
  out.height = height;
  out.window = window;
  out.mean.resize(grey.size());
  out.variance.resize(grey.size());
  out.grey = std::move(grey);
  HWY_DYNAMIC_DISPATCH(find_statistics)(out);
  return out;
}

void reset(const SweepReference& reference, PlaneCosts* costs) {
  costs->first.assign(reference.grey.size(), 1.0f);
  costs->second.assign(reference.grey.size(), 1.0f);
  costs->seen.assign(reference.grey.size(), 0.0f);
}

void add_source(const SweepReference& reference, const SweepSource& source, const float (&h)[9],
                PlaneCosts* costs) {
  HWY_DYNAMIC_DISPATCH(compare)(reference, source, h, *costs);
}

}  // namespace stgs::encoder::geometry
#endif
