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

// The lanes of a vector hold the hypotheses of a pixel.
using Tag = hn::CappedTag<float, kMaxCandidates>;
using V = hn::Vec<Tag>;
using M = hn::Mask<Tag>;

constexpr int kLanes = static_cast<int>(hn::MaxLanes(Tag()));
constexpr int kSupportLanes = static_cast<int>(hn::MaxLanes(GreyTag()));
// Pixels of a support, up to a whole vector.
constexpr int kSupportPadded = (kSupportSize + kSupportLanes - 1) / kSupportLanes * kSupportLanes;

HWY_INLINE V of(float value) {
  return hn::Set(Tag(), value);
}

struct V3 {
  V x, y, z;
};

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

// The hypotheses of a pixel.
struct Candidates {
  HWY_ALIGN float depth[kMaxCandidates], x[kMaxCandidates], y[kMaxCandidates], z[kMaxCandidates];
  int count = 0;

  void consider(Hypothesis plane) {
    if (!(plane.depth > 0.0f)) return;
    depth[count] = plane.depth;
    x[count] = plane.normal.x;
    y[count] = plane.normal.y;
    z[count] = plane.normal.z;
    ++count;
  }
  Hypothesis at(int k) const { return {depth[k], {x[k], y[k], z[k]}}; }
  // Repeats the first one in the rest of the last vector.
  void fill() {
    for (int k = count; k % kLanes != 0; ++k) {
      depth[k] = depth[0];
      x[k] = x[0];
      y[k] = y[0];
      z[k] = z[0];
    }
  }
};

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

// The pixels of a support that are inside the image.
class SupportPixels {
 public:
  // load_support().
  SupportPixels(const StereoImage& image, int x, int y) {
    static const Weights weights;
    const GreyTag d;
    const hn::RebindToSigned<GreyTag> di;
    const hn::RebindToUnsigned<GreyTag> du;
    const GreyV centre = hn::Set(d, grey_at(image, x, y));
    const auto u_at = hn::Set(di, x), v_at = hn::Set(di, y), width = hn::Set(di, image.width);
    GreyV sum = hn::Zero(d), mean = sum, square = sum;
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
      const auto counts = hn::RebindMask(d, inside);
      const GreyV weight = hn::IfThenElseZero(counts, either), weighted = hn::Mul(weight, value);
      hn::CompressStore(weight, counts, d, weight_ + count_);
      hn::CompressStore(weighted, counts, d, weighted_ + count_);
      hn::CompressStore(dx, counts, d, dx_ + count_);
      hn::CompressStore(dy, counts, d, dy_ + count_);
      count_ += static_cast<int>(hn::CountTrue(d, counts));
      sum = hn::Add(sum, weight);
      mean = hn::Add(mean, weighted);
      square = hn::MulAdd(weighted, value, square);
    }
    unit_ = 1.0f / hn::GetLane(hn::SumOfLanes(d, sum));
    mean_ = hn::GetLane(hn::SumOfLanes(d, mean)) * unit_;
    variance_ = math::larger(hn::GetLane(hn::SumOfLanes(d, square)) * unit_ - mean_ * mean_, 0.0f);
  }

  // support_sums() and correlation_cost(). `x`, `y`, `z`: the rows of the homography, from the
  // pixel's position to a source's pixels and their depth; their members are the factors of u and
  // v, and the value at the pixel.
  HWY_INLINE V cost(const StereoImage& source, V3 x, V3 y, V3 z) const {
    const GreyImage<Tag> image(source.corners, source.width, source.height);
    V b = of(0.0f), bb = b, ab = b;
    for (int k = 0, count = count_; k < count; ++k) {
      const V dx = of(dx_[k]), dy = of(dy_[k]), weight = of(weight_[k]);
      const V unit = inverse(hn::Max(along(z, dx, dy), of(1e-9f)));
      const V value = image.at(hn::Mul(along(x, dx, dy), unit), hn::Mul(along(y, dx, dy), unit));
      const V product = hn::Mul(weight, value);
      b = hn::Add(b, product);
      bb = hn::MulAdd(product, value, bb);
      ab = hn::MulAdd(of(weighted_[k]), value, ab);
    }
    return cost_of(hn::Mul(b, of(unit_)), hn::Mul(bb, of(unit_)), hn::Mul(ab, of(unit_)));
  }

 private:
  static HWY_INLINE V along(V3 row, V dx, V dy) {
    return hn::MulAdd(row.x, dx, hn::MulAdd(row.y, dy, row.z));
  }

  HWY_INLINE V cost_of(V b, V bb, V ab) const {
    const V one = of(1.0f), floor = of(kTextureFloor), mean = of(mean_);
    const V variance = hn::Add(hn::Max(hn::NegMulAdd(b, b, bb), of(0.0f)), floor);
    const V spread = hn::Sqrt(hn::Mul(of(variance_ + kTextureFloor), variance));
    const V correlation = hn::Div(hn::NegMulAdd(mean, b, ab), spread);
    const V grey = hn::Min(one, hn::Mul(hn::AbsDiff(mean, b), of(1.0f / kGreyScale)));
    return hn::MulAdd(of(1.0f - kGreyShare), hn::Min(one, hn::Sub(one, correlation)),
                      hn::Mul(of(kGreyShare), grey));
  }

  // With room for a whole vector after the last.
  HWY_ALIGN float weight_[kSupportPadded + kSupportLanes],
      weighted_[kSupportPadded + kSupportLanes];
  HWY_ALIGN float dx_[kSupportPadded + kSupportLanes], dy_[kSupportPadded + kSupportLanes];
  int count_ = 0;
  float unit_, mean_, variance_;
};

// Searches the plane of pixel (x, y).
class PixelSearch {
 public:
  PixelSearch(const StereoProblem& problem, int x, int y)
      : problem_(problem),
        u_(static_cast<float>(x) + 0.5f),
        v_(static_cast<float>(y) + 0.5f),
        ray_(ray_at(problem.reference, u_, v_)),
        support_(problem.reference, x, y) {}

  // Search::consider(), of several hypotheses.
  void consider(Candidates& candidates) {
    candidates.fill();
    HWY_ALIGN float costs[kMaxCandidates];
    const Tag d;
    for (int k = 0; k < candidates.count; k += kLanes) {
      const V3 normal = {hn::Load(d, candidates.x + k), hn::Load(d, candidates.y + k),
                         hn::Load(d, candidates.z + k)};
      hn::Store(cost_of(hn::Load(d, candidates.depth + k), normal), d, costs + k);
    }
    for (int k = 0; k < candidates.count; ++k) {
      if (!(costs[k] < cost_)) continue;
      cost_ = costs[k];
      best_ = candidates.at(k);
    }
  }

  Hypothesis best() const { return best_; }
  float cost() const { return cost_; }

 private:
  // hypothesis_cost().
  HWY_INLINE V cost_of(V depth, V3 normal) const {
    static_assert(kMaxSources <= 4, "the better half of the sources are two at most");
    const StereoImage& from = problem_.reference;
    // plane_row().
    const V unit = hn::Div(of(1.0f), hn::Mul(depth, dot(normal, ray_)));
    const V rx = hn::Mul(normal.x, hn::Mul(unit, of(1.0f / from.fx)));
    const V ry = hn::Mul(normal.y, hn::Mul(unit, of(1.0f / from.fy)));
    const V rz =
        hn::NegMulAdd(rx, of(from.cx), hn::NegMulAdd(ry, of(from.cy), hn::Mul(normal.z, unit)));
    V first = of(1e9f), second = first, seen_by = of(0.0f);
    for (int i = 0; i < problem_.source_count; ++i) {
      const StereoSource& source = problem_.sources[i];
      const Mat3& h = source.infinite;
      // plane_homography(), at the pixel.
      const V3 row = {rx, ry, rz};
      const V3 x = row_at({h.xx, h.xy, h.xz}, source.epipole.x, row);
      const V3 y = row_at({h.yx, h.yy, h.yz}, source.epipole.y, row);
      const V3 z = row_at({h.zx, h.zy, h.zz}, source.epipole.z, row);
      const M seen = is_seen(source.image, x.z, y.z, z.z);
      if (hn::AllFalse(Tag(), seen)) continue;
      V cost = support_.cost(source.image, between_pixels(x, z), between_pixels(y, z), z);
      if (problem_.consistency > 0.0f)
        cost = hn::MulAdd(of(problem_.consistency), reprojection_error(source, depth), cost);
      cost = hn::IfThenElse(seen, cost, of(1e9f));
      second = hn::Min(second, hn::Max(first, cost));
      first = hn::Min(first, cost);
      seen_by = hn::Add(seen_by, hn::IfThenElseZero(seen, of(1.0f)));
    }
    const V mean = hn::Mul(of(0.5f), hn::Add(first, second));
    const V known = hn::IfThenElse(hn::Gt(seen_by, of(2.0f)), mean, first);
    return hn::IfThenElse(hn::Gt(seen_by, of(0.0f)), known, of(kUnseen));
  }

  // A row of a homography with its value at the pixel.
  HWY_INLINE V3 row_at(Vec3 infinite, float epipole, V3 row) const {
    const V e = of(epipole);
    const V a = hn::MulAdd(e, row.x, of(infinite.x)), b = hn::MulAdd(e, row.y, of(infinite.y));
    const V c = hn::MulAdd(e, row.z, of(infinite.z));
    return {a, b, hn::MulAdd(a, of(u_), hn::MulAdd(b, of(v_), c))};
  }

  // From pixels whose centres are at +0.5 to those of grey_vector().
  static HWY_INLINE V3 between_pixels(V3 row, V3 z) {
    const V half = of(0.5f);
    return {hn::NegMulAdd(half, z.x, row.x), hn::NegMulAdd(half, z.y, row.y),
            hn::NegMulAdd(half, z.z, row.z)};
  }

  static HWY_INLINE M is_seen(const StereoImage& image, V x, V y, V z) {
    const V width = of(static_cast<float>(image.width)), zero = of(0.0f);
    const V height = of(static_cast<float>(image.height));
    const M from = hn::And(hn::Ge(x, zero), hn::Ge(y, zero));
    const M to = hn::And(hn::Lt(x, hn::Mul(z, width)), hn::Lt(y, hn::Mul(z, height)));
    return hn::And(hn::Gt(z, of(1e-9f)), hn::And(from, to));
  }

  // reprojection_error(), at most kErrorLimit.
  HWY_INLINE V reprojection_error(const StereoSource& source, V depth) const {
    const Tag d;
    const hn::RebindToSigned<Tag> di;
    const StereoImage &from = problem_.reference, &to = source.image;
    const V3 point = {hn::Mul(depth, of(ray_.x)), hn::Mul(depth, of(ray_.y)), depth};
    const V3 there = plus(times(source.rotation, point), source.translation);
    const V unit = hn::Div(of(1.0f), there.z);
    const V u = hn::MulAdd(hn::Mul(there.x, unit), of(to.fx), of(to.cx));
    const V v = hn::MulAdd(hn::Mul(there.y, unit), of(to.fy), of(to.cy));
    const M inside = hn::And(hn::Gt(there.z, of(0.0f)), is_seen(to, u, v, of(1.0f)));
    const auto px = hn::ConvertTo(di, hn::IfThenElseZero(inside, u));
    const auto py = hn::ConvertTo(di, hn::IfThenElseZero(inside, v));
    const V found = hn::GatherIndex(d, to.depth, hn::Add(hn::Mul(py, hn::Set(di, to.width)), px));
    const V3 seen = {hn::Mul(hn::Mul(hn::Sub(u, of(to.cx)), of(1.0f / to.fx)), found),
                     hn::Mul(hn::Mul(hn::Sub(v, of(to.cy)), of(1.0f / to.fy)), found), found};
    const Vec3 t = source.translation;
    const V3 back = transposed_times(source.rotation, plus(seen, {-t.x, -t.y, -t.z}));
    const V scale = hn::Div(of(1.0f), back.z);
    const V du = hn::MulAdd(hn::Mul(back.x, scale), of(from.fx), of(from.cx - u_));
    const V dv = hn::MulAdd(hn::Mul(back.y, scale), of(from.fy), of(from.cy - v_));
    const V error = hn::Sqrt(hn::MulAdd(du, du, hn::Mul(dv, dv)));
    const M known = hn::And(inside, hn::And(hn::Gt(found, of(0.0f)), hn::Gt(back.z, of(0.0f))));
    return hn::IfThenElse(known, hn::Min(error, of(kErrorLimit)), of(kErrorLimit));
  }

  const StereoProblem& problem_;
  const float u_, v_;
  const Vec3 ray_;
  const SupportPixels support_;
  Hypothesis best_{0.0f, {0.0f, 0.0f, -1.0f}};
  float cost_ = 1e9f;
};

void start(const StereoProblem& problem, const PlaneMap& map, int y, std::uint64_t seed) {
  for (int x = 0; x < problem.reference.width; ++x) {
    const std::size_t at = pixel_index(problem, x, y);
    PixelSearch search(problem, x, y);
    Candidates drawn;
    draw(problem, x, y, random_of(seed, at), drawn);
    search.consider(drawn);
    map.planes[at] = search.best();
    map.costs[at] = search.cost();
  }
}

void update(const StereoProblem& problem, const PlaneMap& map, int y, int colour, int iteration,
            std::uint64_t seed) {
  for (int x = (y + colour) & 1; x < problem.reference.width; x += 2) {
    const std::size_t at = pixel_index(problem, x, y);
    PixelSearch search(problem, x, y);
    Candidates near, varied;
    propagate(problem, map, x, y, near);
    search.consider(near);
    const Hypothesis own = map.planes[at];
    varied.consider(own);
    vary(problem, x, y, map.costs[at] <= search.cost() ? own : search.best(), iteration,
         random_of(seed + static_cast<std::uint64_t>(iteration) + 1, at), varied);
    search.consider(varied);
    map.planes[at] = search.best();
    map.costs[at] = search.cost();
  }
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
