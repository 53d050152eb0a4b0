// SPDX-License-Identifier: Apache-2.0
// The supports of the vectorised stereo. Include after hwy/foreach_target.h, once per target.
#if defined(STGS_STEREO_SUPPORT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_STEREO_SUPPORT_INL_H
#undef STGS_STEREO_SUPPORT_INL_H
#else
#define STGS_STEREO_SUPPORT_INL_H
#endif

#include <hwy/highway.h>
#include <cmath>
#include <cstddef>

#include "geometry/grey_vector-inl.h"
#include "geometry/patch_match.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

// The lanes of a vector hold the hypotheses of a pixel, or those of two pixels in its halves.
using Tag = hn::CappedTag<float, 2 * kMaxCandidates>;
using V = hn::Vec<Tag>;
using M = hn::Mask<Tag>;

constexpr int kLanes = static_cast<int>(hn::MaxLanes(Tag()));
constexpr int kPixels = kLanes > kMaxCandidates ? kLanes / kMaxCandidates : 1;
static_assert(kPixels <= 2);
constexpr int kSupportLanes = static_cast<int>(hn::MaxLanes(GreyTag()));
// Pixels of a support, up to a whole vector.
constexpr int kSupportPadded = (kSupportSize + kSupportLanes - 1) / kSupportLanes * kSupportLanes;

HWY_INLINE V of(float value) {
  return hn::Set(Tag(), value);
}

// The values of kPixels pixels in the lanes of their hypotheses.
HWY_INLINE V of_each(const float* values) {
  if constexpr (kPixels == 1) return of(values[0]);
  return hn::IfThenElse(hn::FirstN(Tag(), kMaxCandidates), of(values[0]), of(values[kPixels - 1]));
}

// Pixels of a row whose hypotheses are compared together.
struct PixelGroup {
  int x[kPixels];
  int count;  // fewer at the end of the row; the rest of `x` repeats the first

  PixelGroup(int first, int step, int width) : x{}, count(0) {
    for (int p = 0; p < kPixels; ++p) {
      const int at = first + p * step;
      x[p] = at < width ? at : first;
      count += at < width ? 1 : 0;
    }
  }
};

struct V3 {
  V x, y, z;
};

HWY_INLINE V dot(V3 a, V3 b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}

HWY_INLINE V dot(V3 a, Vec3 b) {
  return hn::MulAdd(a.x, of(b.x), hn::MulAdd(a.y, of(b.y), hn::Mul(a.z, of(b.z))));
}

HWY_INLINE V3 plus(V3 a, Vec3 b) {
  return {hn::Add(a.x, of(b.x)), hn::Add(a.y, of(b.y)), hn::Add(a.z, of(b.z))};
}

HWY_INLINE V3 times(const Mat3& m, V3 a) {
  return {dot(a, {m.xx, m.xy, m.xz}), dot(a, {m.yx, m.yy, m.yz}), dot(a, {m.zx, m.zy, m.zz})};
}

HWY_INLINE V3 transposed_times(const Mat3& m, V3 a) {
  return {dot(a, {m.xx, m.yx, m.zx}), dot(a, {m.xy, m.yy, m.zy}), dot(a, {m.xz, m.yz, m.zz})};
}

// 1 / a, for a > 0; the largest error is a few units in the last place.
HWY_INLINE V inverse(V a) {
  const V guess = hn::ApproximateReciprocal(a);
  return hn::Mul(guess, hn::NegMulAdd(a, guess, of(2.0f)));
}

// The weights of a support by the difference of grey values, and by position.
struct Weights {
  float of_grey[256], of_place[kSupportPadded];
  HWY_ALIGN float dx[kSupportPadded], dy[kSupportPadded];

  Weights() {
    for (int k = 0; k < 256; ++k) of_grey[k] = std::exp(-static_cast<float>(k) / kGreySigma);
    for (int k = 0; k < kSupportPadded; ++k) {
      const bool padding = k >= kSupportSize;
      dx[k] = padding ? 0.0f : static_cast<float>(support_offset(k % kSupportSide));
      dy[k] = padding ? 0.0f : static_cast<float>(support_offset(k / kSupportSide));
      of_place[k] = std::exp(-(dx[k] * dx[k] + dy[k] * dy[k]) / (2.0f * kSpaceSigma * kSpaceSigma));
    }
  }
};

// load_support().
struct PixelSupport {
  // Padded to whole vectors; 0 outside of the image. The weights do not sum to 1, but to 1 / unit.
  HWY_ALIGN float weight[kSupportPadded], weighted[kSupportPadded];
  float unit, mean, variance;

  PixelSupport(const StereoImage& image, int x, int y) {
    static const Weights weights;
    const GreyTag d;
    const hn::RebindToSigned<GreyTag> di;
    const hn::RebindToUnsigned<GreyTag> du;
    const GreyV centre = hn::Set(d, grey_at(image, x, y));
    const auto u_at = hn::Set(di, x), v_at = hn::Set(di, y), width = hn::Set(di, image.width);
    GreyV sum = hn::Zero(d), product = sum, square = sum;
    for (int k = 0; k < kSupportPadded; k += kSupportLanes) {
      const GreyV dx = hn::Load(d, weights.dx + k), dy = hn::Load(d, weights.dy + k);
      const auto u = hn::Add(u_at, hn::ConvertTo(di, dx)), v = hn::Add(v_at, hn::ConvertTo(di, dy));
      const auto lane = hn::Add(hn::Iota(di, 0), hn::Set(di, k));
      auto inside = hn::And(hn::Gt(u, hn::Set(di, -1)), hn::Gt(v, hn::Set(di, -1)));
      inside = hn::And(inside, hn::And(hn::Lt(u, width), hn::Lt(v, hn::Set(di, image.height))));
      inside = hn::And(inside, hn::Lt(lane, hn::Set(di, kSupportSize)));
      const auto index = hn::IfThenElseZero(inside, hn::Add(hn::Mul(v, width), u));
      const GreyV value = corner<0>(d, hn::GatherIndex(du, image.corners, index));
      const auto difference = hn::ConvertTo(di, hn::AbsDiff(value, centre));
      const GreyV either = hn::Mul(hn::GatherIndex(d, weights.of_grey, difference),
                                   hn::LoadU(d, weights.of_place + k));
      const GreyV own = hn::IfThenElseZero(hn::RebindMask(d, inside), either);
      const GreyV own_value = hn::Mul(own, value);
      hn::Store(own, d, weight + k);
      hn::Store(own_value, d, weighted + k);
      sum = hn::Add(sum, own);
      product = hn::Add(product, own_value);
      square = hn::MulAdd(own_value, value, square);
    }
    unit = 1.0f / hn::GetLane(hn::SumOfLanes(d, sum));
    mean = hn::GetLane(hn::SumOfLanes(d, product)) * unit;
    variance = math::larger(hn::GetLane(hn::SumOfLanes(d, square)) * unit - mean * mean, 0.0f);
  }
};

// The supports of a group, in the lanes of the hypotheses of its pixels.
class GroupSupport {
 public:
  GroupSupport(const StereoImage& image, const PixelGroup& group, int y) {
    const Tag d;
    float unit[kPixels], mean[kPixels], variance[kPixels];
    for (int p = 0; p < kPixels; ++p) {
      const PixelSupport pixel(image, group.x[p], y);
      unit[p] = pixel.unit;
      mean[p] = pixel.mean;
      variance[p] = pixel.variance;
      const M others = hn::Not(hn::FirstN(d, static_cast<std::size_t>(p) * kMaxCandidates));
      for (int k = 0; k < kSupportSize; ++k) {
        hn::BlendedStore(of(pixel.weight[k]), others, d, weight_ + k * kLanes);
        hn::BlendedStore(of(pixel.weighted[k]), others, d, weighted_ + k * kLanes);
      }
    }
    hn::Store(of_each(unit), d, unit_);
    hn::Store(of_each(mean), d, mean_);
    hn::Store(of_each(variance), d, variance_);
  }

  // support_sums() and correlation_cost(). `x`, `y`, `z`: the rows of the homography, from the
  // pixel's position to a source's pixels and their depth; their members are the factors of u and
  // v, and the value at the pixel.
  HWY_INLINE V cost(const StereoImage& source, V3 x, V3 y, V3 z) const {
    const Tag d;
    const GreyImage<Tag> image(source.corners, source.width, source.height);
    V b = of(0.0f), bb = b, ab = b;
    const float *weight = weight_, *weighted = weighted_;
    for (int j = 0; j < kSupportSide; ++j) {
      const V dy = of(static_cast<float>(support_offset(j)));
      const V xs = hn::MulAdd(x.y, dy, x.z), ys = hn::MulAdd(y.y, dy, y.z);
      const V zs = hn::MulAdd(z.y, dy, z.z);
      for (int i = 0; i < kSupportSide; ++i, weight += kLanes, weighted += kLanes) {
        const V dx = of(static_cast<float>(support_offset(i)));
        const V unit = inverse(hn::Max(hn::MulAdd(z.x, dx, zs), of(1e-9f)));
        const V value = image.at(hn::Mul(hn::MulAdd(x.x, dx, xs), unit),
                                 hn::Mul(hn::MulAdd(y.x, dx, ys), unit));
        const V product = hn::Mul(hn::Load(d, weight), value);
        b = hn::Add(b, product);
        bb = hn::MulAdd(product, value, bb);
        ab = hn::MulAdd(hn::Load(d, weighted), value, ab);
      }
    }
    const V unit = hn::Load(d, unit_);
    return cost_of(hn::Mul(b, unit), hn::Mul(bb, unit), hn::Mul(ab, unit));
  }

 private:
  HWY_INLINE V cost_of(V b, V bb, V ab) const {
    const V one = of(1.0f), floor = of(kTextureFloor), mean = hn::Load(Tag(), mean_);
    const V variance = hn::Add(hn::Max(hn::NegMulAdd(b, b, bb), of(0.0f)), floor);
    const V own = hn::Add(hn::Load(Tag(), variance_), floor);
    const V spread = hn::Sqrt(hn::Mul(own, variance));
    const V correlation = hn::Div(hn::NegMulAdd(mean, b, ab), spread);
    const V grey = hn::Min(one, hn::Mul(hn::AbsDiff(mean, b), of(1.0f / kGreyScale)));
    return hn::MulAdd(of(1.0f - kGreyShare), hn::Min(one, hn::Sub(one, correlation)),
                      hn::Mul(of(kGreyShare), grey));
  }

  HWY_ALIGN float weight_[kSupportSize * kLanes], weighted_[kSupportSize * kLanes];
  HWY_ALIGN float unit_[kLanes], mean_[kLanes], variance_[kLanes];
};

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
