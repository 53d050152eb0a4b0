// SPDX-License-Identifier: Apache-2.0
#include "init/velocity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nanoflann.hpp>

#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

constexpr int kMatchRounds = 6;
constexpr std::size_t kPointsPerTask = 128;  // few frames of a live window occupy all threads
constexpr int kMinForMedian = 3;
constexpr std::size_t kWide = 25,
                      kNarrow = 9;  // neighbours that smooth, in all rounds and the last
// Flow of all frames takes long, so its residual has to be this fraction of the other at most, in
// each measured frame.
constexpr double kClearlyLess = 0.99;

// nanoflann's data set adaptor for points with position and weighted colour.
struct Cloud {
  static constexpr int kDimensions = 6;
  std::vector<std::array<double, kDimensions>> rows;

  Cloud(const std::vector<SurfacePoint>& points, double colour_weight) {
    for (const SurfacePoint& p : points) {
      rows.push_back({p.position[0], p.position[1], p.position[2], colour_weight * p.colour[0],
                      colour_weight * p.colour[1], colour_weight * p.colour[2]});
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

struct Neighbours {
  std::vector<std::uint32_t> index;
  std::vector<double> squared;  // distances
};

Neighbours nearest(const Tree& tree, const std::array<double, Cloud::kDimensions>& query,
                   std::size_t count) {
  Neighbours out{std::vector<std::uint32_t>(count), std::vector<double>(count)};
  const std::size_t found =
      tree.knnSearch(query.data(), count, out.index.data(), out.squared.data());
  out.index.resize(found);
  out.squared.resize(found);
  return out;
}

double median(std::vector<double>& values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

const cv::Vec3d kUnknown = cv::Vec3d::all(std::numeric_limits<double>::quiet_NaN());

bool known(const cv::Vec3d& v) {
  return v[0] == v[0];
}

// Smooths velocities of points among their nearest neighbours.
class Smoother {
 public:
  // `most`: neighbours of a point, at most; those farther than `reach` do not count.
  Smoother(const std::vector<SurfacePoint>& points, double reach, std::size_t most)
      : reach_(reach) {
    const Cloud cloud(points, 0.2 * reach / 255);
    const Tree tree(Cloud::kDimensions, cloud);
    neighbours_.resize(cloud.rows.size());
    parallel_for(std::size_t{0}, cloud.rows.size(),
                 [&](std::size_t i) { neighbours_[i] = nearest(tree, cloud.rows[i], most); });
  }

  // Replaces each velocity by the median of the known velocities of the `count` nearest points, or
  // by kUnknown if there are fewer than kMinForMedian.
  Velocities smoothed(const Velocities& raw, std::size_t count) const {
    Velocities out(raw.size(), kUnknown);
    parallel_blocks(std::size_t{0}, raw.size(), kPointsPerTask,
                    [&](std::size_t begin, std::size_t end) {
                      std::vector<double> parts[3];
                      for (std::size_t i = begin; i < end; ++i)
                        out[i] = smoothed_at(i, raw, count, parts);
                    });
    return out;
  }

 private:
  // `parts`: memory for the components.
  cv::Vec3d smoothed_at(std::size_t i, const Velocities& raw, std::size_t count,
                        std::vector<double> (&parts)[3]) const {
    const Neighbours& near = neighbours_[i];
    for (auto& part : parts) part.clear();
    for (std::size_t k = 0; k < std::min(count, near.index.size()); ++k) {
      const cv::Vec3d& v = raw[near.index[k]];
      if (near.squared[k] > reach_ * reach_ || !known(v)) continue;
      for (int d = 0; d < 3; ++d) parts[d].push_back(v[d]);
    }
    if (int(parts[0].size()) < kMinForMedian) return kUnknown;
    return {median(parts[0]), median(parts[1]), median(parts[2])};
  }

  double reach_;
  std::vector<Neighbours> neighbours_;  // nearest first
};

// The constraint of one view on a velocity: two rows of d(pixel)/d(world) and the flow.
struct FlowRow {
  cv::Vec3d du, dv;
  cv::Vec2d flow;
  double weight = 1;
};

FlowRow flow_row(const View& view, const cv::Vec3d& p, const cv::Vec2d& flow) {
  const cv::Vec3d c = view.to_camera(p);
  const double iz = 1 / c[2];
  const cv::Matx33d& r = view.rotation;
  FlowRow row;
  for (int k = 0; k < 3; ++k) {
    row.du[k] = view.fx * iz * (r(0, k) - c[0] * iz * r(2, k));
    row.dv[k] = view.fy * iz * (r(1, k) - c[1] * iz * r(2, k));
  }
  row.flow = flow;
  return row;
}

// Solves weighted least squares with weights that fall with the residual. Damping sets components
// that the flow does not determine (along parallel rays) to 0.
cv::Vec3d solve_flow(std::vector<FlowRow>& rows) {
  cv::Vec3d v(0, 0, 0);
  for (int round = 0; round < 4; ++round) {
    cv::Matx33d a = cv::Matx33d::zeros();
    cv::Vec3d b(0, 0, 0);
    double trace = 0;
    for (const FlowRow& row : rows) {
      a += row.weight * (row.du * row.du.t() + row.dv * row.dv.t());
      b += row.weight * (row.flow[0] * row.du + row.flow[1] * row.dv);
    }
    for (int k = 0; k < 3; ++k) trace += a(k, k);
    for (int k = 0; k < 3; ++k) a(k, k) += 2e-3 * trace;
    v = a.solve(b, cv::DECOMP_CHOLESKY);
    for (FlowRow& row : rows) {
      const double error = std::hypot(row.du.dot(v) - row.flow[0], row.dv.dot(v) - row.flow[1]);
      row.weight = 1 / (1 + error * error);
    }
  }
  return v;
}

}  // namespace

Velocities match_velocities(const std::vector<SurfacePoint>& points,
                            const std::vector<SurfacePoint>& next, double reach, double sign) {
  Velocities steps(points.size(), kUnknown);
  if (points.empty() || next.empty()) return steps;
  const double colour_weight = 2 * reach / 255;
  const Cloud from(points, colour_weight), to(next, colour_weight);
  const Tree tree(Cloud::kDimensions, to);
  const Smoother smoother(points, reach, kWide);
  // The nearest point underestimates motion along the surface. Each round therefore searches again
  // from the position moved by the smoothed velocity.
  for (int round = 0; round < kMatchRounds; ++round) {
    Velocities raw(points.size(), kUnknown);
    parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
      auto query = from.rows[i];
      for (int k = 0; k < 3 && known(steps[i]); ++k) query[k] += steps[i][k];
      // The mean of the nearest three reduces the effect of the sampling of the next frame.
      cv::Vec3d sum(0, 0, 0);
      int n = 0;
      std::uint32_t nearest_three[3];
      double squared[3];
      const std::size_t found = tree.knnSearch(query.data(), 3, nearest_three, squared);
      for (std::size_t k = 0; k < found; ++k) {
        const cv::Vec3d step = next[nearest_three[k]].position - points[i].position;
        if (cv::norm(step) > reach) continue;
        sum += step;
        ++n;
      }
      if (n > 0) raw[i] = sum * (1.0 / n);
    });
    steps = smoother.smoothed(raw, round + 1 < kMatchRounds ? kWide : kNarrow);
  }
  for (cv::Vec3d& step : steps) step *= sign;
  return steps;
}

Velocities flow_velocities(const std::vector<SurfacePoint>& points, const std::vector<View>& views,
                           const std::vector<ViewMotion>& motion, int frame, double reach) {
  Velocities raw(points.size(), kUnknown);
  std::vector<Fronts> fronts;
  fronts.reserve(views.size());
  for (const View& view : views) fronts.emplace_back(view, points);
  parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    std::vector<FlowRow> rows;
    for (std::size_t k = 0; k < views.size(); ++k) {
      const Pixel p = project(views[k], points[i].position);
      cv::Vec2d flow;
      if (!p.inside || !motion[k].flow[frame].at(p.u, p.v, &flow) || fronts[k].hides(p)) continue;
      rows.push_back(flow_row(views[k], points[i].position, flow));
    }
    if (rows.size() < 2) return;
    const cv::Vec3d v = solve_flow(rows);
    if (cv::norm(v) <= reach) raw[i] = v;
  });
  return Smoother(points, reach, kNarrow).smoothed(raw, kNarrow);
}

Velocities fill_unknown(const Velocities& first, const Velocities& second) {
  Velocities out = first;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!known(out[i])) out[i] = second[i];
    if (!known(out[i])) out[i] = {0, 0, 0};
  }
  return out;
}

Velocities propagate_velocities(const DynamicFrame& last, const DynamicFrame& before,
                                const Velocities& velocities) {
  Velocities out(last.points.size(), cv::Vec3d(0, 0, 0));
  for (std::size_t i = 0; i < last.points.size(); ++i) {
    double best = 1e300;
    for (std::size_t k = 0; k < before.points.size(); ++k) {
      const double d =
          cv::norm(before.points[k].position + velocities[k] - last.points[i].position);
      if (d < best) best = d, out[i] = velocities[k];
    }
  }
  return out;
}

namespace {

Velocities matched_of(const VelocityInput& input, int frame) {
  const int interval = input.interval;
  const std::vector<SurfacePoint>& points = input.frames[frame].points;
  const bool forward = frame + interval < input.capture.frames;
  const int other = forward ? frame + interval : frame - interval;
  if (other < 0 || points.empty()) return Velocities(points.size(), cv::Vec3d(0, 0, 0));
  Velocities found = match_velocities(points, input.frames[other].points, interval * input.reach,
                                      forward ? 1 : -1);
  for (cv::Vec3d& velocity : found) velocity *= 1.0 / interval;
  return fill_unknown(found, found);
}

// Returns the velocities of a frame by its flow, or by `matched` where it gives none.
Velocities flowed_of(const VelocityInput& input, int frame, const Velocities& matched) {
  const std::vector<SurfacePoint>& points = input.frames[frame].points;
  if (points.empty()) return {};
  return fill_unknown(flow_velocities(points, input.views, input.motion, frame, input.reach),
                      matched);
}

// Mean residuals of the estimates over the measured frames.
struct Residuals {
  double zero = 0, matched = 0, flowed = 0;
  int frames = 0;
  bool flow_wins = false;
};

// Returns the frames to measure, of which the first is the most typical.
std::vector<int> measured_frames(const VelocityInput& input) {
  const int last = input.capture.frames - 2;
  std::vector<int> out;
  for (const int frame : {last / 2, 0, last}) {
    const bool is_new = std::find(out.begin(), out.end(), frame) == out.end();
    if (frame >= 0 && is_new && !input.frames[frame].points.empty()) out.push_back(frame);
  }
  return out;
}

// Measures one frame after the other, until flow does not win: finding it takes long.
Result<Residuals> find_residuals(const VelocityInput& input,
                                 const std::vector<Velocities>& matched) {
  Residuals out;
  for (const int frame : measured_frames(input)) {
    const std::vector<SurfacePoint>& points = input.frames[frame].points;
    STGS_TRY(input.find_flow({frame}));
    const Velocities estimates[] = {Velocities(points.size(), cv::Vec3d(0, 0, 0)), matched[frame],
                                    flowed_of(input, frame, matched[frame])};
    STGS_ASSIGN(const std::vector<MotionFit> fits,
                measure_motion(input.capture, input.views, points, estimates, frame + 1));
    if (fits[0].samples == 0) continue;
    const int n = ++out.frames;
    out.zero += (fits[0].residual() - out.zero) / n;
    out.matched += (fits[1].residual() - out.matched) / n;
    out.flowed += (fits[2].residual() - out.flowed) / n;
    out.flow_wins = fits[2].residual() < kClearlyLess * fits[1].residual();
    if (!out.flow_wins) break;
  }
  return out;
}

// Replaces velocities by those from flow.
Status take_flow(const VelocityInput& input, Work& work, std::vector<Velocities>* velocities) {
  const int last = input.capture.frames - 1;
  std::vector<int> frames;
  for (int frame = 0; frame < last; ++frame)
    if (!input.frames[frame].points.empty()) frames.push_back(frame);
  STGS_TRY(input.find_flow(frames));
  STGS_TRY(work.for_each(last, [&](int frame) -> Status {
    (*velocities)[frame] = flowed_of(input, frame, (*velocities)[frame]);
    return {};
  }));
  (*velocities)[last] =
      propagate_velocities(input.frames[last], input.frames[last - 1], (*velocities)[last - 1]);
  return {};
}

}  // namespace

Status choose_velocities(const VelocityInput& input, Work& work, ChosenVelocities* out) {
  work.stage("velocities", input.find_flow && input.capture.frames > 1 ? 6 : 1);
  out->frames.resize(input.capture.frames);
  STGS_TRY(work.for_each(input.capture.frames, [&](int frame) -> Status {
    out->frames[frame] = matched_of(input, frame);
    return {};
  }));
  if (!input.find_flow) {
    out->kind = "nearest neighbours";
    return {};
  }
  STGS_ASSIGN(const Residuals mean, find_residuals(input, out->frames));
  if (mean.frames == 0) {
    work.log("velocities: not measured (no dynamic points in the sampled frames)");
    return {};
  }
  if (mean.flow_wins) STGS_TRY(take_flow(input, work, &out->frames));
  out->kind = mean.flow_wins ? "lifted flow" : "nearest neighbours";
  work.log(
      fmt::format("velocities: {} (residual in the next frame: zero velocity {:.2f}, nearest "
                  "neighbours {:.2f}, lifted flow {:.2f})",
                  out->kind, mean.zero, mean.matched, mean.flowed));
  return {};
}

}  // namespace stgs::encoder::init
