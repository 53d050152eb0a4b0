// SPDX-License-Identifier: Apache-2.0
#include "init/velocity.h"

#include <algorithm>
#include <cmath>

#include "init/velocity_gpu.h"
#include "init/velocity_match.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

// Flow of all frames takes long, so its residual has to be this fraction of the other at most, in
// each measured frame.
constexpr double kClearlyLess = 0.99;

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
  constexpr std::size_t kCount = geometry::kNarrowNeighbours;
  return Smoother(points, reach, kCount).smoothed(raw, kCount);
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
  geometry::VelocityMatcher* const gpu =
      gpu_within_limits(input.gpu, input.frames, input.interval, work);
  STGS_TRY(match_frames(input.frames, input.interval, input.reach, gpu, work, &out->frames));
  const std::string backend = gpu != nullptr ? gpu->name() : "cpu";
  if (!input.find_flow) {
    out->kind = "nearest neighbours";
    work.log(fmt::format("velocities: {}, backend {}", out->kind, backend), 3);
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
                  "neighbours {:.2f}, lifted flow {:.2f}), backend {}",
                  out->kind, mean.zero, mean.matched, mean.flowed, backend));
  return {};
}

}  // namespace stgs::encoder::init
