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
constexpr int kMeasuredFrames = 3;  // compare the two estimates
// Flow of all frames takes long, so its residual has to be this fraction of the other at most.
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

// Returns the depth of the nearest point in each coarse cell of a view, for occlusion tests.
cv::Mat nearest_depths(const View& view, const std::vector<SurfacePoint>& points, int cell) {
  cv::Mat depth((view.height + cell - 1) / cell, (view.width + cell - 1) / cell, CV_32F,
                cv::Scalar(1e30));
  for (const SurfacePoint& point : points) {
    const Pixel p = project(view, point.position);
    if (!p.inside) continue;
    float& d = depth.at<float>(p.y() / cell, p.x() / cell);
    d = std::min(d, float(p.depth));
  }
  return depth;
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
      for (const std::uint32_t k : nearest(tree, query, 3).index) {
        const cv::Vec3d step = next[k].position - points[i].position;
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
  constexpr int kCell = 6;
  Velocities raw(points.size(), kUnknown);
  std::vector<cv::Mat> fronts;
  fronts.reserve(views.size());
  for (const View& view : views) fronts.push_back(nearest_depths(view, points, kCell));
  for (std::size_t i = 0; i < points.size(); ++i) {
    std::vector<FlowRow> rows;
    for (std::size_t k = 0; k < views.size(); ++k) {
      const Pixel p = project(views[k], points[i].position);
      cv::Vec2d flow;
      if (!p.inside || !motion[k].flow[frame].at(p.u, p.v, &flow)) continue;
      const float front = fronts[k].at<float>(p.y() / kCell, p.x() / kCell);
      if (p.depth > 1.05 * front) continue;
      rows.push_back(flow_row(views[k], points[i].position, flow));
    }
    if (rows.size() < 2) continue;
    const cv::Vec3d v = solve_flow(rows);
    if (cv::norm(v) <= reach) raw[i] = v;
  }
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

Result<MotionFit> measure_motion(const PreparedCapture& capture, const std::vector<View>& views,
                                 const std::vector<SurfacePoint>& points,
                                 const Velocities& velocities, int next_frame) {
  MotionFit fit;
  long inside = 0;
  double difference = 0;
  for (const View& view : views) {
    STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, view, next_frame));
    if (mask.empty()) continue;
    STGS_ASSIGN(const cv::Mat image, load_image(capture, view, next_frame));
    std::vector<SurfacePoint> moved = points;
    for (std::size_t i = 0; i < points.size(); ++i) moved[i].position += velocities[i];
    constexpr int kCell = 6;
    const cv::Mat front = nearest_depths(view, moved, kCell);
    for (const SurfacePoint& point : moved) {
      const Pixel p = project(view, point.position);
      if (!p.inside || p.depth > 1.05 * front.at<float>(p.y() / kCell, p.x() / kCell)) continue;
      ++fit.samples;
      inside += mask.at<std::uint8_t>(p.y(), p.x()) ? 1 : 0;
      const auto& c = image.at<cv::Vec3b>(p.y(), p.x());
      for (int k = 0; k < 3; ++k) difference += std::abs(int(c[k]) - int(point.colour[k])) / 3.0;
    }
  }
  if (fit.samples == 0) return fit;
  fit.inside = double(inside) / double(fit.samples);
  fit.colour = difference / double(fit.samples);
  return fit;
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

struct Residuals {
  double zero = 0, matched = 0, flowed = 0;
  bool measured = false;
};

Result<Residuals> residuals_of(const VelocityInput& input, const Velocities& matched, int frame) {
  const std::vector<SurfacePoint>& points = input.frames[frame].points;
  const auto fit = [&](const Velocities& velocities) {
    return measure_motion(input.capture, input.views, points, velocities, frame + 1);
  };
  STGS_ASSIGN(const MotionFit zero, fit(Velocities(points.size(), cv::Vec3d(0, 0, 0))));
  STGS_ASSIGN(const MotionFit by_match, fit(matched));
  STGS_ASSIGN(const MotionFit by_flow, fit(flowed_of(input, frame, matched)));
  return Residuals{zero.residual(), by_match.residual(), by_flow.residual(), zero.samples > 0};
}

// Returns the mean over some frames.
Result<Residuals> mean_residuals(const VelocityInput& input, const std::vector<Velocities>& matched,
                                 Work& work) {
  const int frames = input.capture.frames,
            count = std::max(0, std::min(frames - 1, kMeasuredFrames));
  std::vector<int> measured;
  for (int i = 0; i < count; ++i) {
    const int frame = count == 1 ? 0 : i * (frames - 2) / (count - 1);
    if (!input.frames[frame].points.empty()) measured.push_back(frame);
  }
  STGS_TRY(input.find_flow(measured));
  std::vector<Residuals> found(measured.size());
  STGS_TRY(work.for_each(int(measured.size()), [&](int i) -> Status {
    STGS_ASSIGN(found[i], residuals_of(input, matched[measured[i]], measured[i]));
    return {};
  }));
  Residuals mean;
  for (const Residuals& one : found) {
    if (!one.measured) continue;
    mean.zero += one.zero / count;
    mean.matched += one.matched / count;
    mean.flowed += one.flowed / count;
    mean.measured = true;
  }
  return mean;
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
  work.stage("velocities", input.find_flow && input.capture.frames > 1 ? 5 : 1);
  out->frames.resize(input.capture.frames);
  STGS_TRY(work.for_each(input.capture.frames, [&](int frame) -> Status {
    out->frames[frame] = matched_of(input, frame);
    return {};
  }));
  if (!input.find_flow) {
    out->kind = "nearest neighbours";
    return {};
  }
  STGS_ASSIGN(const Residuals mean, mean_residuals(input, out->frames, work));
  if (!mean.measured) {
    work.log("velocities: not measured (no dynamic points in the sampled frames)");
    return {};
  }
  const bool flow_wins = mean.flowed < kClearlyLess * mean.matched;
  if (flow_wins) STGS_TRY(take_flow(input, work, &out->frames));
  out->kind = flow_wins ? "lifted flow" : "nearest neighbours";
  work.log(
      fmt::format("velocities: {} (residual in the next frame: zero velocity {:.2f}, nearest "
                  "neighbours {:.2f}, lifted flow {:.2f})",
                  out->kind, mean.zero, mean.matched, mean.flowed));
  return {};
}

}  // namespace stgs::encoder::init
