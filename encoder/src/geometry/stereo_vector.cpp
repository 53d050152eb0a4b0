// SPDX-License-Identifier: Apache-2.0
#include "geometry/stereo_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/stereo_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#include "geometry/stereo_support-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

// The hypotheses of a group, kMaxCandidates slots per pixel.
struct Candidates {
  static constexpr int kSlots = kPixels * kMaxCandidates;
  HWY_ALIGN float depth[kSlots], x[kSlots], y[kSlots], z[kSlots];
  int count[kPixels] = {};
  int pixel = 0;  // whose hypotheses are added

  void consider(Hypothesis plane) {
    HWY_DASSERT(count[pixel] < kMaxCandidates);
    if (plane.depth > 0.0f) set(pixel * kMaxCandidates + count[pixel]++, plane);
  }
  Hypothesis at(int k) const { return {depth[k], {x[k], y[k], z[k]}}; }
  // Sets the other slots to a hypothesis of their pixel, or to any if it has none.
  void fill() {
    for (int p = 0; p < kPixels; ++p) {
      const int first = p * kMaxCandidates;
      const Hypothesis plane = count[p] > 0 ? at(first) : Hypothesis{1.0f, {0.0f, 0.0f, -1.0f}};
      for (int k = count[p]; k < kMaxCandidates; ++k) set(first + k, plane);
    }
  }
  // The slots up to the last hypothesis.
  int used() const { return kPixels == 1 ? count[0] : kSlots; }

 private:
  void set(int k, Hypothesis plane) {
    depth[k] = plane.depth;
    x[k] = plane.normal.x;
    y[k] = plane.normal.y;
    z[k] = plane.normal.z;
  }
};

// Searches the planes of a group of pixels of row y.
class GroupSearch {
 public:
  GroupSearch(const StereoProblem& problem, const PixelGroup& group, int y)
      : problem_(problem),
        group_(group),
        y_(y),
        v_(static_cast<float>(y) + 0.5f),
        support_(problem.reference, group, y) {
    float u[kPixels], ray_x[kPixels];
    for (int p = 0; p < kPixels; ++p) {
      best_[p] = {0.0f, {0.0f, 0.0f, -1.0f}};
      cost_[p] = 1e9f;
      u[p] = static_cast<float>(group.x[p]) + 0.5f;
      const Vec3 ray = ray_at(problem.reference, u[p], v_);
      ray_x[p] = ray.x;
      ray_y_ = ray.y;
    }
    hn::Store(of_each(u), Tag(), u_);
    hn::Store(of_each(ray_x), Tag(), ray_x_);
  }

  // Search::consider(), of several hypotheses.
  void consider(Candidates& candidates) {
    candidates.fill();
    HWY_ALIGN float costs[Candidates::kSlots];
    const Tag d;
    for (int k = 0; k < candidates.used(); k += kLanes) {
      const V3 normal = {hn::Load(d, candidates.x + k), hn::Load(d, candidates.y + k),
                         hn::Load(d, candidates.z + k)};
      hn::Store(cost_of(hn::Load(d, candidates.depth + k), normal), d, costs + k);
    }
    for (int p = 0; p < group_.count; ++p) {
      const int first = p * kMaxCandidates;
      for (int k = first; k < first + candidates.count[p]; ++k) {
        if (!(costs[k] < cost_[p])) continue;
        cost_[p] = costs[k];
        best_[p] = candidates.at(k);
      }
    }
  }

  Hypothesis best(int pixel) const { return best_[pixel]; }
  float cost(int pixel) const { return cost_[pixel]; }
  // Stores the best hypotheses of the group.
  void store(const PlaneMap& map) const {
    for (int p = 0; p < group_.count; ++p) {
      const std::size_t at = pixel_index(problem_, group_.x[p], y_);
      map.planes[at] = best_[p];
      map.costs[at] = cost_[p];
    }
  }

 private:
  // hypothesis_cost().
  HWY_INLINE V cost_of(V depth, V3 normal) const {
    static_assert(kMaxSources <= 4, "the better half of the sources are two at most");
    const StereoImage& from = problem_.reference;
    // plane_row().
    const V u = hn::Load(Tag(), u_);
    const V3 ray = {hn::Load(Tag(), ray_x_), of(ray_y_), of(1.0f)};
    const V unit = hn::Div(of(1.0f), hn::Mul(depth, dot(normal, ray)));
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
      const V3 x = row_at({h.xx, h.xy, h.xz}, source.epipole.x, row, u);
      const V3 y = row_at({h.yx, h.yy, h.yz}, source.epipole.y, row, u);
      const V3 z = row_at({h.zx, h.zy, h.zz}, source.epipole.z, row, u);
      const M seen = is_seen(source.image, x.z, y.z, z.z);
      if (hn::AllFalse(Tag(), seen)) continue;
      V cost = support_.cost(source.image, between_pixels(x, z), between_pixels(y, z), z);
      if (problem_.consistency > 0.0f)
        cost =
            hn::MulAdd(of(problem_.consistency), reprojection_error(source, depth, ray, u), cost);
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
  HWY_INLINE V3 row_at(Vec3 infinite, float epipole, V3 row, V u) const {
    const V e = of(epipole);
    const V a = hn::MulAdd(e, row.x, of(infinite.x)), b = hn::MulAdd(e, row.y, of(infinite.y));
    const V c = hn::MulAdd(e, row.z, of(infinite.z));
    return {a, b, hn::MulAdd(a, u, hn::MulAdd(b, of(v_), c))};
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
  HWY_INLINE V reprojection_error(const StereoSource& source, V depth, V3 ray, V u_from) const {
    const Tag d;
    const hn::RebindToSigned<Tag> di;
    const StereoImage &from = problem_.reference, &to = source.image;
    const V3 point = {hn::Mul(depth, ray.x), hn::Mul(depth, ray.y), depth};
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
    const V du = hn::MulAdd(hn::Mul(back.x, scale), of(from.fx), hn::Sub(of(from.cx), u_from));
    const V dv = hn::MulAdd(hn::Mul(back.y, scale), of(from.fy), of(from.cy - v_));
    const V error = hn::Sqrt(hn::MulAdd(du, du, hn::Mul(dv, dv)));
    const M known = hn::And(inside, hn::And(hn::Gt(found, of(0.0f)), hn::Gt(back.z, of(0.0f))));
    return hn::IfThenElse(known, hn::Min(error, of(kErrorLimit)), of(kErrorLimit));
  }

  const StereoProblem& problem_;
  const PixelGroup& group_;
  const int y_;
  const float v_;
  float ray_y_ = 0.0f;
  HWY_ALIGN float u_[kLanes], ray_x_[kLanes];
  const GroupSupport support_;
  Hypothesis best_[kPixels];
  float cost_[kPixels];
};

void start(const StereoProblem& problem, const PlaneMap& map, int y, std::uint64_t seed) {
  const int width = problem.reference.width;
  for (int x = 0; x < width; x += kPixels) {
    const PixelGroup group(x, 1, width);
    GroupSearch search(problem, group, y);
    Candidates drawn;
    for (int p = 0; p < group.count; ++p) {
      drawn.pixel = p;
      draw(problem, group.x[p], y, random_of(seed, pixel_index(problem, group.x[p], y)), drawn);
    }
    search.consider(drawn);
    search.store(map);
  }
}

// Searches without planes of an earlier pass.
void explore(const StereoProblem& problem, const PlaneMap& map, const PixelGroup& group, int y,
             int iteration, std::uint64_t seed, GroupSearch& search) {
  Candidates near, varied;
  for (int p = 0; p < group.count; ++p) {
    near.pixel = p;
    propagate(problem, map, group.x[p], y, true, near);
  }
  search.consider(near);
  for (int p = 0; p < group.count; ++p) {
    const std::size_t at = pixel_index(problem, group.x[p], y);
    const Hypothesis own = map.planes[at];
    varied.pixel = p;
    varied.consider(own);
    vary(problem, group.x[p], y, map.costs[at] <= search.cost(p) ? own : search.best(p), iteration,
         random_of(seed, at), varied);
  }
  search.consider(varied);
}

void update(const StereoProblem& problem, const PlaneMap& map, int y, int colour, int iteration,
            std::uint64_t seed) {
  const int width = problem.reference.width;
  const std::uint64_t own_seed = seed + static_cast<std::uint64_t>(iteration) + 1;
  for (int x = (y + colour) & 1; x < width; x += 2 * kPixels) {
    const PixelGroup group(x, 2, width);
    GroupSearch search(problem, group, y);
    if (is_refining(problem)) {
      Candidates all;
      for (int p = 0; p < group.count; ++p) {
        all.pixel = p;
        refine(problem, map, group.x[p], y, iteration,
               random_of(own_seed, pixel_index(problem, group.x[p], y)), all);
      }
      search.consider(all);
    } else {
      explore(problem, map, group, y, iteration, own_seed, search);
    }
    search.store(map);
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
