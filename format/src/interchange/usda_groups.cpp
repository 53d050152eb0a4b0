// SPDX-License-Identifier: Apache-2.0
#include "interchange/usda_groups.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

// Greatest differences of a primitive that is written without time samples, at any frame.
constexpr double kStaticOpacity = 0.5 / 255;
constexpr double kStaticPosition = 0.02;  // in its middle standard deviation
constexpr double kNoFrame = -1;

}  // namespace

UsdaGroups UsdaGrouper::groups(UsdaStatistics& statistics) const {
  UsdaGroups out;
  std::size_t i = 0;
  if (scene_.parts.empty()) {
    for (; i < set_.size(); ++i) add(i, nullptr, out, statistics);
  }
  for (const ScenePart& part : scene_.parts) {
    for (std::uint64_t k = 0; k < part.primitives; ++k, ++i) add(i, &part, out, statistics);
  }
  return out;
}

float UsdaGrouper::constant_opacity(std::size_t i) const {
  const OpacityRange range = opacities(i);
  return static_cast<float>((range.low + range.high) / 2);
}

double UsdaGrouper::opacity_at(std::size_t i, const ScenePart* part, double ticks) const {
  if (part != nullptr && !part->shows(ticks, scene_.metadata.frames)) return 0;
  const double begin = part == nullptr ? 0 : part->begin_ticks;
  const auto dt = static_cast<float>(ticks - begin - set_.time[i]);
  const double opacity = double{math::opacity_of(set_.opacity_logit[i])} *
                         math::visibility(dt, set_.sigma[i], set_.radius[i]);
  return opacity < math::kAlphaThreshold ? 0 : opacity;
}

void UsdaGrouper::add(std::size_t i, const ScenePart* part, UsdaGroups& out,
                      UsdaStatistics& statistics) const {
  const math::Support support =
      math::candidate_support(math::opacity_of(set_.opacity_logit[i]), 0, set_.sigma[i],
                              set_.radius[i], math::kAlphaThreshold);
  const double centre = (part == nullptr ? 0 : part->begin_ticks) + double{set_.time[i]};
  double begin = std::max(0.0, std::ceil(centre + support.begin));
  double end = std::min<double>(last_frame_, std::floor(centre + support.end));
  if (part != nullptr) {  // a long lifespan may begin many frames before its part
    begin = std::max(begin, std::ceil(part->displayed_range().begin));
    end = std::min(end, std::floor(part->displayed_range().end));
  }
  // The end of a part is outside of it, except at the end of the clip.
  if (part != nullptr && begin <= end && !part->shows(end, scene_.metadata.frames)) --end;
  const double peak = begin <= end ? visible_frame(i, part, centre, begin, end) : kNoFrame;
  if (peak == kNoFrame) {
    statistics.between_frames += support.begin < support.end ? 1 : 0;
    return;
  }
  begin = last_visible(i, part, peak, begin);
  end = last_visible(i, part, peak, end);
  out[group_of(i, part, begin, end, statistics)].push_back(static_cast<std::uint32_t>(i));
}

// Returns a frame of [begin, end], which are shown, with the greatest opacity: one of the two next
// to the centre of the lifespan. kNoFrame if the opacity is 0 at both.
double UsdaGrouper::visible_frame(std::size_t i, const ScenePart* part, double centre, double begin,
                                  double end) const {
  for (const double nearest : {std::floor(centre), std::ceil(centre)}) {
    const double frame = std::clamp(nearest, begin, end);
    if (opacity_at(i, part, frame) > 0) return frame;
  }
  return kNoFrame;
}

// Returns the frame nearest to `limit` with an opacity above 0. `visible` has one, and between both
// the opacity only decreases, so that 32 steps suffice for any clip.
double UsdaGrouper::last_visible(std::size_t i, const ScenePart* part, double visible,
                                 double limit) const {
  if (opacity_at(i, part, limit) > 0) return limit;
  while (std::abs(limit - visible) > 1) {
    const double middle = std::floor(0.5 * (visible + limit));
    (opacity_at(i, part, middle) > 0 ? visible : limit) = middle;
  }
  return visible;
}

// Returns the range of the opacity over the frames of a scene without parts.
UsdaGrouper::OpacityRange UsdaGrouper::opacities(std::size_t i) const {
  const double nearest = std::clamp<double>(set_.time[i], 0, last_frame_);
  return {std::min(opacity_at(i, nullptr, 0), opacity_at(i, nullptr, last_frame_)),
          opacity_at(i, nullptr, nearest)};
}

// Returns half the length of the path over all frames.
double UsdaGrouper::half_path(std::size_t i) const {
  const float* u = set_.velocity.data() + 3 * i;
  return 0.5 * last_frame_ *
         std::sqrt(double{u[0]} * u[0] + double{u[1]} * u[1] + double{u[2]} * u[2]);
}

double UsdaGrouper::middle_scale(std::size_t i) const {
  std::array<float, 3> log_scale;
  std::copy_n(set_.log_scale.data() + 3 * i, 3, log_scale.begin());
  std::sort(log_scale.begin(), log_scale.end());
  return std::exp(double{log_scale[1]});
}

UsdaGroup UsdaGrouper::group_of(std::size_t i, const ScenePart* part, double begin, double end,
                                UsdaStatistics& statistics) const {
  if (part == nullptr && begin == 0 && end == last_frame_) {
    const OpacityRange range = opacities(i);
    if (range.high - range.low <= 2 * kStaticOpacity) {
      statistics.static_opacity_max =
          std::max(statistics.static_opacity_max, (range.high - range.low) / 2);
      const double path = half_path(i);
      if (path > kStaticPosition * middle_scale(i)) return {UsdaGroup::kMoves, 0, last_frame_};
      statistics.static_position_max = std::max(statistics.static_position_max, path);
      return {UsdaGroup::kStatic, 0, last_frame_};
    }
  }
  // A frame before and after, where the opacity is 0.
  const auto first = static_cast<std::uint64_t>(std::max(0.0, begin - 1));
  const auto last = static_cast<std::uint64_t>(std::min<double>(last_frame_, end + 1));
  // Windows of 2^(k+1) frames at multiples of 2^k contain every run of up to 2^k frames.
  std::uint64_t length = 4;
  while (length < last - first + 1) length *= 2;
  const std::uint64_t window = first / length * length;
  const std::uint64_t window_last = std::min<std::uint64_t>(last_frame_, window + 2 * length - 1);
  return {UsdaGroup::kFades, static_cast<std::uint32_t>(window),
          static_cast<std::uint32_t>(window_last)};
}

}  // namespace stgs
