// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_statistics.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

constexpr double kRadiusShare = 0.95;
constexpr int kSlowestDecade = -5, kFastestDecade = 2;  // of the bins of speed
constexpr int kMaxDoublings = 20;                       // of the bins of lifespan

// Returns the value below which `share` of the values lie; 0 if there are none.
double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

// Bins [0, edges[0]), ..., [edges.back(), infinity).
std::vector<HistogramBin> histogram(const std::vector<double>& values,
                                    const std::vector<double>& edges) {
  std::vector<HistogramBin> bins(edges.size() + 1);
  for (std::size_t i = 0; i < edges.size(); ++i) bins[i].to = bins[i + 1].from = edges[i];
  for (const double value : values) {
    const auto above = std::upper_bound(edges.begin(), edges.end(), value);
    ++bins[static_cast<std::size_t>(above - edges.begin())].count;
  }
  return bins;
}

// Bin edges from about half a tick to the length of the clip.
std::vector<double> lifespan_edges(double clip, double tick) {
  std::vector<double> edges;
  for (double edge = clip; edge > 0.4 * tick && edges.size() < kMaxDoublings; edge /= 2) {
    edges.push_back(edge);
  }
  std::reverse(edges.begin(), edges.end());
  return edges;
}

std::vector<double> speed_edges() {
  std::vector<double> edges;
  for (int half = 2 * kSlowestDecade; half <= 2 * kFastestDecade; ++half) {
    edges.push_back(std::pow(10.0, half / 2.0));
  }
  return edges;
}

double radius_of(const Gaussians4D& set, const std::vector<std::size_t>& visible) {
  double centre[3] = {};
  std::vector<double> values(visible.size());
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t k = 0; k < visible.size(); ++k) values[k] = set.position[3 * visible[k] + c];
    centre[c] = quantile(values, 0.5);
  }
  for (std::size_t k = 0; k < visible.size(); ++k) {
    const float* p = &set.position[3 * visible[k]];
    values[k] = std::hypot(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]);
  }
  return quantile(values, kRadiusShare);
}

// Returns the half width of the support, ticks; -1 if it is empty.
float half_width_of(const Gaussians4D& set, std::size_t i) {
  return math::support_half_width(math::opacity_of(set.opacity_logit[i]), set.sigma[i],
                                  set.radius[i], math::kAlphaThreshold);
}

double speed_of(const Gaussians4D& set, std::size_t i) {
  const float* u = &set.velocity[3 * i];
  return std::hypot(static_cast<double>(u[0]), static_cast<double>(u[1]),
                    static_cast<double>(u[2]));
}

}  // namespace

double SceneStatistics::static_share() const {
  const std::uint64_t visible = primitives - never_visible;
  return visible == 0 ? 0 : static_cast<double>(static_primitives) / static_cast<double>(visible);
}

ShownFrameTable::ShownFrameTable(const Scene& scene) : scene_(scene) {
  std::uint64_t end = 0;
  for (const ScenePart& part : scene.parts) ends_.push_back(end += part.primitives);
}

ShownFrames ShownFrameTable::frames(std::size_t i) const {
  const double last = std::max(0.0, static_cast<double>(scene_.metadata.frames) - 1);
  const auto end = std::upper_bound(ends_.begin(), ends_.end(), i);
  if (end == ends_.end()) return {0, last, 0};
  const ScenePart& part = scene_.parts[static_cast<std::size_t>(end - ends_.begin())];
  const double first = std::max(0.0, std::ceil(part.displayed_range().begin));
  // The end is exclusive, except that of the timeline.
  const double end_frame = std::min(last, std::ceil(part.displayed_range().end) - 1);
  return {first, std::max(first, end_frame), part.begin_ticks};
}

bool ShownFrameTable::covers_clip(std::size_t i) const {
  const ShownFrames shown = frames(i);
  const double time = shown.part_begin + scene_.gaussians.time[i];
  const double half = half_width_of(scene_.gaussians, i);
  return half >= 0 && time - half <= shown.first && time + half >= shown.last;
}

SceneStatistics scene_statistics(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  const TimeBase& base = scene.metadata.time_base;
  SceneStatistics out;
  out.primitives = set.size();
  out.clip_seconds = base.seconds(scene.metadata.frames);
  std::vector<std::size_t> visible;
  std::vector<double> half_widths;  // ticks
  for (std::size_t i = 0; i < set.size(); ++i) {
    const float half = half_width_of(set, i);
    if (!(half >= 0)) continue;
    visible.push_back(i);
    half_widths.push_back(half);
  }
  out.never_visible = set.size() - visible.size();
  out.scene_radius = radius_of(set, visible);
  out.static_bound = kStaticShare * out.scene_radius;

  std::vector<double> all, within, speeds;
  double drift = 0;
  const ShownFrameTable table(scene);
  for (std::size_t k = 0; k < visible.size(); ++k) {
    const double half = half_widths[k];
    const double speed = speed_of(set, visible[k]);  // scene units per tick
    all.push_back(base.seconds(2 * half));
    speeds.push_back(speed / base.seconds(1));
    if (!table.covers_clip(visible[k])) {
      within.push_back(all.back());
      continue;
    }
    const ShownFrames frames = table.frames(visible[k]);
    const double path = speed * (frames.last - frames.first);
    ++out.whole_clip;
    drift += path;
    if (path <= out.static_bound) ++out.static_primitives;
  }
  if (out.whole_clip > 0) out.whole_clip_drift = drift / static_cast<double>(out.whole_clip);
  out.lifespans = histogram(within, lifespan_edges(out.clip_seconds, base.seconds(1)));
  out.median_lifespan = quantile(all, 0.5);
  out.speeds = histogram(speeds, speed_edges());
  out.median_speed = quantile(speeds, 0.5);
  return out;
}

}  // namespace stgs
