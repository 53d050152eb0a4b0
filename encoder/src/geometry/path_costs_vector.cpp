// SPDX-License-Identifier: Apache-2.0
#include "geometry/path_costs.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/path_costs_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#include "geometry/sweep_rule.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using PathTag = hn::CappedTag<std::uint16_t, 16>;
using PathV = hn::Vec<PathTag>;

constexpr int kPathLanes = static_cast<int>(hn::MaxLanes(PathTag()));
constexpr std::uint16_t kNone = 0xffff;  // cost of a plane that does not exist

// The paths to a row of pixels: the costs of each pixel's planes, with planes that do not exist
// before the first and after the last, and the lowest cost.
class PathRow {
 public:
  explicit PathRow(const CostVolume& volume)
      : pitch_(volume.pitch + 2 * kPathLanes),
        costs_(static_cast<std::size_t>(volume.width) * pitch_, kNone),
        best_(static_cast<std::size_t>(volume.width)) {}

  std::uint16_t* at(int x) {
    return costs_.data() + static_cast<std::ptrdiff_t>(x) * pitch_ + kPathLanes;
  }
  int& best(int x) { return best_[static_cast<std::size_t>(x)]; }

 private:
  int pitch_;
  std::vector<std::uint16_t> costs_;
  std::vector<int> best_;
};

// The planes of a vector that exist.
HWY_INLINE hn::Mask<PathTag> existing(int plane, int planes) {
  return hn::FirstN(PathTag(), static_cast<std::size_t>(std::clamp(planes - plane, 0, kPathLanes)));
}

// Starts the path of pixel x, whose costs are `cost`.
void start_path(const CostVolume& volume, const std::uint8_t* cost, int x, PathRow& row) {
  std::uint16_t* out = row.at(x);
  std::copy_n(cost, volume.planes, out);
  row.best(x) = *std::min_element(out, out + volume.planes);
}

// Continues the path of pixel `from_x` of another row or the same to pixel x.
void continue_path(const CostVolume& volume, const std::uint8_t* cost, PathRow& from_row,
                   int from_x, int step, int x, PathRow& row) {
  const PathTag d;
  const hn::Rebind<std::uint8_t, PathTag> d8;
  const std::uint16_t* from = from_row.at(from_x);
  std::uint16_t* out = row.at(x);
  const int base = from_row.best(from_x);
  const PathV small = hn::Set(d, std::uint16_t{kSmallStep}), none = hn::Set(d, kNone);
  const PathV jump = hn::Set(d, static_cast<std::uint16_t>(base + step));
  const PathV lowest = hn::Set(d, static_cast<std::uint16_t>(base));
  PathV best = none;
  for (int k = 0; k < volume.planes; k += kPathLanes) {
    const PathV side =
        hn::SaturatedAdd(hn::Min(hn::LoadU(d, from + k - 1), hn::LoadU(d, from + k + 1)), small);
    const PathV path = hn::Min(hn::Min(hn::LoadU(d, from + k), side), jump);
    const PathV own = hn::PromoteTo(d, hn::LoadU(d8, cost + k));
    const PathV value =
        hn::IfThenElse(existing(k, volume.planes), hn::Add(own, hn::Sub(path, lowest)), none);
    hn::StoreU(value, d, out + k);
    best = hn::Min(best, value);
  }
  row.best(x) = hn::GetLane(hn::MinOfLanes(d, best));
}

void add_row(const CostVolume& volume, PathRow& row, std::uint16_t* sum) {
  const PathTag d;
  for (int x = 0; x < volume.width; ++x) {
    const std::uint16_t* costs = row.at(x);
    for (int k = 0; k < volume.pitch; k += kPathLanes, sum += kPathLanes)
      hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::LoadU(d, costs + k)), d, sum);
  }
}

void add(const std::vector<float>& grey, int dx, int dy, CostVolume& volume) {
  PathRow previous(volume), current(volume);
  const auto grey_at = [&](int x, int y) {
    return grey[static_cast<std::size_t>(y) * volume.width + x];
  };
  for (int j = 0; j < volume.height; ++j) {
    const int y = dy < 0 ? volume.height - 1 - j : j;
    for (int i = 0; i < volume.width; ++i) {
      const int x = dx < 0 ? volume.width - 1 - i : i;
      const int px = x - dx, py = y - dy;
      const std::uint8_t* cost = &volume.cost[volume.at(x, y)];
      if (px < 0 || py < 0 || px >= volume.width || py >= volume.height) {
        start_path(volume, cost, x, current);
        continue;
      }
      const int step = large_step(std::abs(grey_at(x, y) - grey_at(px, py)));
      continue_path(volume, cost, dy == 0 ? current : previous, px, step, x, current);
    }
    add_row(volume, current, &volume.sum[volume.at(0, y)]);
    std::swap(previous, current);
  }
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(add);

CostVolume::CostVolume(int width_, int height_, int planes_)
    : width(width_), height(height_), planes(planes_), pitch((planes_ + 15) / 16 * 16) {
  const std::size_t size = static_cast<std::size_t>(width) * height * pitch;
  cost.resize(size);
  sum.resize(size);
}

void add_paths(const std::vector<float>& grey, int dx, int dy, CostVolume* volume) {
  HWY_DYNAMIC_DISPATCH(add)(grey, dx, dy, *volume);
}

}  // namespace stgs::encoder::geometry
#endif
