// SPDX-License-Identifier: Apache-2.0
#include "init/velocity_match.h"

#include <algorithm>
#include <array>
#include <nanoflann.hpp>

#include "init/velocity_gpu.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

using geometry::kMatchedPoints;

constexpr std::size_t kPointsPerTask = 128;  // few frames of a live window occupy all threads

// nanoflann's data set adaptor for points with position and weighted colour.
struct Cloud {
  static constexpr int kDimensions = 6;
  std::vector<std::array<double, kDimensions>> rows;

  // `colour`: the distance between channels 0 and 255.
  Cloud(const std::vector<SurfacePoint>& points, double colour) {
    const double weight = colour / 255;
    for (const SurfacePoint& p : points) {
      rows.push_back({p.position[0], p.position[1], p.position[2], weight * p.colour[0],
                      weight * p.colour[1], weight * p.colour[2]});
    }
  }
  std::size_t kdtree_get_point_count() const { return rows.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t d) const { return rows[i][d]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud,
                                                 Cloud::kDimensions>;

// Returns the mean of the steps to the nearest points of `next`, which reduces the effect of the
// sampling of that frame.
cv::Vec3d matched_step(const cv::Vec3d& position,
                       const std::array<double, Cloud::kDimensions>& query, const Tree& tree,
                       const std::vector<SurfacePoint>& next, double reach) {
  cv::Vec3d sum(0, 0, 0);
  int n = 0;
  std::uint32_t nearest[kMatchedPoints];
  double squared[kMatchedPoints];
  const std::size_t found = tree.knnSearch(query.data(), kMatchedPoints, nearest, squared);
  for (std::size_t k = 0; k < found; ++k) {
    const cv::Vec3d step = next[nearest[k]].position - position;
    if (cv::norm(step) > reach) continue;
    sum += step;
    ++n;
  }
  return n > 0 ? sum * (1.0 / n) : kUnknown;
}

}  // namespace

Smoother::Smoother(const std::vector<SurfacePoint>& points, double reach, std::size_t count)
    : reach_(reach) {
  const Cloud cloud(points, geometry::kSmoothColour * reach);
  const Tree tree(Cloud::kDimensions, cloud);
  neighbours_.resize(cloud.rows.size());
  parallel_for(std::size_t{0}, cloud.rows.size(), [&](std::size_t i) {
    Neighbours& out = neighbours_[i];
    out.index.resize(count);
    out.squared.resize(count);
    const std::size_t found =
        tree.knnSearch(cloud.rows[i].data(), count, out.index.data(), out.squared.data());
    out.index.resize(found);
    out.squared.resize(found);
  });
}

Velocities Smoother::smoothed(const Velocities& raw, std::size_t count) const {
  Velocities out(raw.size(), kUnknown);
  parallel_blocks(std::size_t{0}, raw.size(), kPointsPerTask,
                  [&](std::size_t begin, std::size_t end) {
                    for (std::size_t i = begin; i < end; ++i) out[i] = smoothed_at(i, raw, count);
                  });
  return out;
}

cv::Vec3d Smoother::smoothed_at(std::size_t i, const Velocities& raw, std::size_t count) const {
  const Neighbours& near = neighbours_[i];
  double parts[3][geometry::kWideNeighbours];
  int n = 0;
  for (std::size_t k = 0; k < std::min(count, near.index.size()); ++k) {
    const cv::Vec3d& v = raw[near.index[k]];
    if (near.squared[k] > reach_ * reach_ || !known(v)) continue;
    for (int d = 0; d < 3; ++d) parts[d][n] = v[d];
    ++n;
  }
  if (n < geometry::kMinForMedian) return kUnknown;
  return {geometry::median_of(parts[0], n), geometry::median_of(parts[1], n),
          geometry::median_of(parts[2], n)};
}

Velocities fill_unknown(const Velocities& first, const Velocities& second) {
  Velocities out = first;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!known(out[i])) out[i] = second[i];
    if (!known(out[i])) out[i] = {0, 0, 0};
  }
  return out;
}

Velocities match_velocities(const std::vector<SurfacePoint>& points,
                            const std::vector<SurfacePoint>& next, double reach) {
  Velocities steps(points.size(), kUnknown);
  if (points.empty() || next.empty()) return steps;
  const double colour = geometry::kMatchColour * reach;
  const Cloud from(points, colour), to(next, colour);
  const Tree tree(Cloud::kDimensions, to);
  const Smoother smoother(points, reach, geometry::kWideNeighbours);
  // The nearest point underestimates motion along the surface. Each round therefore searches again
  // from the position moved by the smoothed velocity.
  for (int round = 0; round < geometry::kMatchRounds; ++round) {
    Velocities raw(points.size(), kUnknown);
    parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
      auto query = from.rows[i];
      for (int k = 0; k < 3 && known(steps[i]); ++k) query[k] += steps[i][k];
      raw[i] = matched_step(points[i].position, query, tree, next, reach);
    });
    steps = smoother.smoothed(raw, std::size_t(geometry::smoothing_neighbours(round)));
  }
  return steps;
}

std::vector<FrameMatch> matches_of(const std::vector<DynamicFrame>& frames, int interval) {
  std::vector<FrameMatch> out;
  const int count = int(frames.size());
  for (int frame = 0; frame < count; ++frame) {
    const bool forward = frame + interval < count;
    const int other = forward ? frame + interval : frame - interval;
    if (other < 0 || frames[frame].points.empty() || frames[other].points.empty()) continue;
    out.push_back({frame, other, (forward ? 1.0 : -1.0) / interval});
  }
  return out;
}

Status match_frames(const std::vector<DynamicFrame>& frames, int interval, double reach,
                    geometry::VelocityMatcher* gpu, Work& work, std::vector<Velocities>* out) {
  out->resize(frames.size());
  for (std::size_t frame = 0; frame < frames.size(); ++frame)
    (*out)[frame].assign(frames[frame].points.size(), cv::Vec3d(0, 0, 0));
  const std::vector<FrameMatch> matches = matches_of(frames, interval);
  const double step = interval * reach;
  if (gpu == nullptr) {
    STGS_TRY(work.for_each(int(matches.size()), [&](int k) -> Status {
      const FrameMatch& match = matches[k];
      Velocities& velocities = (*out)[match.from];
      velocities = match_velocities(frames[match.from].points, frames[match.to].points, step);
      for (cv::Vec3d& velocity : velocities) velocity *= match.per_frame;
      return {};
    }));
  } else {
    STGS_TRY(work.wait_for([&] { return match_on_gpu(frames, matches, step, *gpu, work, out); }));
  }
  for (Velocities& velocities : *out) velocities = fill_unknown(velocities, velocities);
  return {};
}

}  // namespace stgs::encoder::init
