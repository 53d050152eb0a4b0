// SPDX-License-Identifier: Apache-2.0
#include "geometry/stereo_rows.h"

#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/stereo_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#include "geometry/grey_vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

using Tag = GreyTag;
using V = GreyV;

constexpr int kLanes = static_cast<int>(hn::MaxLanes(Tag()));
// Vectors beyond these hold only padding.
constexpr int kVectors = (kSupportSize + kLanes - 1) / kLanes;
static_assert(kVectors * kLanes <= kSupportPadded);

// The weights of a support by the difference of grey values, and by position.
struct Weights {
  float of_grey[256], of_place[kSupportPadded];

  Weights() {
    for (int k = 0; k < 256; ++k) of_grey[k] = std::exp(-static_cast<float>(k) / kGreySigma);
    for (int k = 0; k < kSupportPadded; ++k) {
      const int dx = support_offset(k % kSupportSide), dy = support_offset(k / kSupportSide);
      of_place[k] =
          std::exp(-static_cast<float>(dx * dx + dy * dy) / (2.0f * kSpaceSigma * kSpaceSigma));
    }
  }
};

// Loads a support and sums over its pixels, a vector at a time.
class VectorSums {
 public:
  VectorSums() {
    for (int k = 0; k < kSupportPadded; ++k) {
      const bool padding = k >= kSupportSize;
      x_[k] = padding ? 0.0f : static_cast<float>(support_offset(k % kSupportSide));
      y_[k] = padding ? 0.0f : static_cast<float>(support_offset(k / kSupportSide));
    }
  }

  // load_support().
  void load(const StereoImage& image, int x, int y, Support* support) const {
    static const Weights weights;
    const Tag d;
    const hn::RebindToSigned<Tag> di;
    const hn::RebindToUnsigned<Tag> du;
    const V centre = hn::Set(d, grey_at(image, x, y));
    const auto u_at = hn::Set(di, x), v_at = hn::Set(di, y), width = hn::Set(di, image.width);
    V sum = hn::Zero(d), mean = sum, square = sum;
    for (int k = 0; k < kVectors * kLanes; k += kLanes) {
      const auto u = hn::Add(u_at, hn::ConvertTo(di, hn::Load(d, x_ + k)));
      const auto v = hn::Add(v_at, hn::ConvertTo(di, hn::Load(d, y_ + k)));
      const auto lane = hn::Add(hn::Iota(di, 0), hn::Set(di, k));
      auto inside = hn::And(hn::Gt(u, hn::Set(di, -1)), hn::Gt(v, hn::Set(di, -1)));
      inside = hn::And(inside, hn::And(hn::Lt(u, width), hn::Lt(v, hn::Set(di, image.height))));
      inside = hn::And(inside, hn::Lt(lane, hn::Set(di, kSupportSize)));
      const auto index = hn::IfThenElseZero(inside, hn::Add(hn::Mul(v, width), u));
      const V value = corner<0>(hn::GatherIndex(du, image.corners, index));
      const auto difference = hn::ConvertTo(di, hn::AbsDiff(value, centre));
      const V weight = hn::IfThenElseZero(hn::RebindMask(d, inside),
                                          hn::Mul(hn::GatherIndex(d, weights.of_grey, difference),
                                                  hn::LoadU(d, weights.of_place + k)));
      const V weighted = hn::Mul(weight, value);
      hn::StoreU(weight, d, support->weight + k);
      hn::StoreU(weighted, d, support->weighted + k);
      sum = hn::Add(sum, weight);
      mean = hn::Add(mean, weighted);
      square = hn::MulAdd(weighted, value, square);
    }
    const float unit = 1.0f / hn::GetLane(hn::SumOfLanes(d, sum));
    for (int k = 0; k < kVectors * kLanes; k += kLanes) {
      const V share = hn::Set(d, unit);
      hn::StoreU(hn::Mul(hn::LoadU(d, support->weight + k), share), d, support->weight + k);
      hn::StoreU(hn::Mul(hn::LoadU(d, support->weighted + k), share), d, support->weighted + k);
    }
    support->mean = hn::GetLane(hn::SumOfLanes(d, mean)) * unit;
    support->variance = math::larger(
        hn::GetLane(hn::SumOfLanes(d, square)) * unit - support->mean * support->mean, 0.0f);
  }

  SupportSums operator()(const StereoImage& source, const Mat3& h, const Support& support, int x,
                         int y) const {
    const Tag d;
    const float u = static_cast<float>(x) + 0.5f, v = static_cast<float>(y) + 0.5f;
    const V x_at = hn::Set(d, h.xx * u + h.xy * v + h.xz);
    const V y_at = hn::Set(d, h.yx * u + h.yy * v + h.yz);
    const V z_at = hn::Set(d, h.zx * u + h.zy * v + h.zz);
    V b = hn::Zero(d), bb = b, ab = b;
    for (int k = 0; k < kVectors * kLanes; k += kLanes) {
      const V dx = hn::Load(d, x_ + k), dy = hn::Load(d, y_ + k);
      const V z = hn::MulAdd(hn::Set(d, h.zx), dx, hn::MulAdd(hn::Set(d, h.zy), dy, z_at));
      const V unit = hn::Div(hn::Set(d, 1.0f), hn::Max(z, hn::Set(d, 1e-9f)));
      const V su = hn::MulAdd(hn::Set(d, h.xx), dx, hn::MulAdd(hn::Set(d, h.xy), dy, x_at));
      const V sv = hn::MulAdd(hn::Set(d, h.yx), dx, hn::MulAdd(hn::Set(d, h.yy), dy, y_at));
      const V value = grey(source, hn::Mul(su, unit), hn::Mul(sv, unit));
      const V weighted = hn::Mul(hn::LoadU(d, support.weight + k), value);
      b = hn::Add(b, weighted);
      bb = hn::MulAdd(weighted, value, bb);
      ab = hn::MulAdd(hn::LoadU(d, support.weighted + k), value, ab);
    }
    return {hn::GetLane(hn::SumOfLanes(d, b)), hn::GetLane(hn::SumOfLanes(d, bb)),
            hn::GetLane(hn::SumOfLanes(d, ab))};
  }

 private:
  // grey_between().
  static HWY_INLINE V grey(const StereoImage& source, V u, V v) {
    const V half = hn::Set(Tag(), 0.5f);
    return grey_vector(source.corners, source.width, source.height, hn::Sub(u, half),
                       hn::Sub(v, half));
  }

  HWY_ALIGN float x_[kSupportPadded], y_[kSupportPadded];
};

void start(const StereoProblem& problem, const PlaneMap& map, int y, std::uint64_t seed) {
  const VectorSums sums;
  for (int x = 0; x < problem.reference.width; ++x) start_pixel(problem, map, x, y, seed, sums);
}

void update(const StereoProblem& problem, const PlaneMap& map, int y, int colour, int iteration,
            std::uint64_t seed) {
  const VectorSums sums;
  for (int x = (y + colour) & 1; x < problem.reference.width; x += 2)
    update_pixel(problem, map, x, y, iteration, seed, sums);
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(start);
HWY_EXPORT(update);

void start_row(const StereoProblem& problem, const PlaneMap& map, int y, std::uint64_t seed) {
  HWY_DYNAMIC_DISPATCH(start)(problem, map, y, seed);
}

void update_row(const StereoProblem& problem, const PlaneMap& map, int y, int colour, int iteration,
                std::uint64_t seed) {
  HWY_DYNAMIC_DISPATCH(update)(problem, map, y, colour, iteration, seed);
}

}  // namespace stgs::encoder::geometry
#endif
