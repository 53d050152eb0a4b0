// SPDX-License-Identifier: Apache-2.0
#include "geometry/ray_votes.h"

#include <algorithm>
#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/ray_votes_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using VoteTag = hn::CappedTag<float, 16>;
using VoteV = hn::Vec<VoteTag>;

void vote(const VotingView& view, float nearest, RayVotes& votes) {
  const VoteTag d;
  const hn::RebindToSigned<VoteTag> di;
  const VoteV zero = hn::Zero(d), one = hn::Set(d, 1.0f), least = hn::Set(d, nearest);
  for (std::size_t k = 0; k < votes.depths.size(); k += hn::Lanes(d)) {
    const VoteV depth = hn::LoadU(d, votes.depths.data() + k);
    const auto at = [&](int axis) {
      return hn::MulAdd(hn::Set(d, view.along[axis]), depth, hn::Set(d, view.start[axis]));
    };
    const VoteV z = at(2);
    const VoteV unit = hn::Div(one, hn::Max(z, least));
    const VoteV u = hn::MulAdd(hn::Mul(at(0), unit), hn::Set(d, view.fx), hn::Set(d, view.cx));
    const VoteV v = hn::MulAdd(hn::Mul(at(1), unit), hn::Set(d, view.fy), hn::Set(d, view.cy));
    auto visible = hn::And(hn::Ge(z, least), hn::And(hn::Ge(u, zero), hn::Ge(v, zero)));
    visible = hn::And(visible, hn::Lt(u, hn::Set(d, static_cast<float>(view.width))));
    visible = hn::And(visible, hn::Lt(v, hn::Set(d, static_cast<float>(view.height))));
    if (hn::AllFalse(d, visible)) continue;
    const auto x = hn::ConvertTo(di, hn::IfThenElseZero(visible, u));
    const auto y = hn::ConvertTo(di, hn::IfThenElseZero(visible, v));
    const auto index = hn::Add(hn::Mul(y, hn::Set(di, view.width)), x);
    const VoteV hiding = hn::GatherIndex(d, view.hiding, index);
    visible = hn::And(visible, hn::Le(z, hn::Abs(hiding)));
    const VoteV in = hn::IfThenElseZero(hn::And(visible, hn::Lt(hiding, zero)), one);
    const VoteV out = hn::IfThenElseZero(hn::And(visible, hn::Ge(hiding, zero)), one);
    float *inside = votes.inside.data() + k, *outside = votes.outside.data() + k;
    hn::StoreU(hn::Add(hn::LoadU(d, inside), in), d, inside);
    hn::StoreU(hn::Add(hn::LoadU(d, outside), out), d, outside);
  }
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::geometry {

HWY_EXPORT(vote);

RayVotes::RayVotes(const std::vector<float>& points) : depths(points) {
  resize(points.size());
}

void RayVotes::resize(std::size_t points) {
  constexpr std::size_t kMaxLanes = 16;
  const std::size_t padded = (points + kMaxLanes - 1) / kMaxLanes * kMaxLanes;
  count = points;
  depths.resize(padded, 0.0f);
  inside.resize(padded, 0.0f);
  outside.resize(padded, 0.0f);
}

void add_votes(const VotingView& view, float nearest, RayVotes* votes) {
  HWY_DYNAMIC_DISPATCH(vote)(view, nearest, *votes);
}

}  // namespace stgs::encoder::geometry
#endif
