// SPDX-License-Identifier: Apache-2.0
#include "init/velocity_gpu.h"

#include <map>

namespace stgs::encoder::init {
namespace {

using geometry::MatchPoint;
using geometry::PairCost;
using geometry::VelocityProblem;

std::vector<MatchPoint> match_points(const std::vector<SurfacePoint>& points,
                                     const cv::Vec3d& origin) {
  std::vector<MatchPoint> out;
  out.reserve(points.size());
  for (const SurfacePoint& p : points) {
    const cv::Vec3f at = p.position - origin;
    out.push_back(
        {at[0], at[1], at[2], float(p.colour[0]), float(p.colour[1]), float(p.colour[2])});
  }
  return out;
}

PairCost cost_of(const std::vector<DynamicFrame>& frames, const FrameMatch& match) {
  return geometry::pair_cost(frames[match.from].points.size(), frames[match.to].points.size());
}

bool is_within_limits(const PairCost& cost) {
  return cost.comparisons <= geometry::kMaxProblemCost.comparisons &&
         cost.bytes <= geometry::kMaxProblemCost.bytes;
}

// Returns the end of the matches from `first` on that are a problem; at least one.
std::size_t problem_end(const std::vector<DynamicFrame>& frames,
                        const std::vector<FrameMatch>& matches, std::size_t first) {
  PairCost sum = cost_of(frames, matches[first]);
  std::size_t end = first + 1;
  for (; end < matches.size() && end - first < geometry::kMaxProblemPairs; ++end) {
    const PairCost next = cost_of(frames, matches[end]);
    sum = {sum.comparisons + next.comparisons, sum.bytes + next.bytes};
    if (!is_within_limits(sum)) break;
  }
  return end;
}

// Adds the points of frames that are used the first time.
class ProblemBuilder {
 public:
  ProblemBuilder(const std::vector<DynamicFrame>& frames, const cv::Vec3d& origin, double reach)
      : frames_(frames), origin_(origin) {
    problem.reach = reach;
  }
  void add(const FrameMatch& match) {
    const std::size_t from = add_frame(match.from), to = add_frame(match.to);
    problem.pairs.push_back({from, to});
  }

  VelocityProblem problem;

 private:
  std::size_t add_frame(int frame) {
    const auto [at, is_new] = added_.try_emplace(frame, problem.frames.size());
    if (is_new) problem.frames.push_back(match_points(frames_[frame].points, origin_));
    return at->second;
  }

  const std::vector<DynamicFrame>& frames_;
  const cv::Vec3d origin_;
  std::map<int, std::size_t> added_;  // index in the problem of each frame
};

}  // namespace

geometry::VelocityMatcher* affordable_gpu(geometry::VelocityMatcher* gpu,
                                          const std::vector<DynamicFrame>& frames, int interval,
                                          const Work& work) {
  if (gpu == nullptr) return nullptr;
  for (const FrameMatch& match : matches_of(frames, interval)) {
    if (is_within_limits(cost_of(frames, match))) continue;
    work.log(fmt::format(
        "velocities: frames {} and {} have {} and {} points, too many to compare all on the GPU "
        "(at most about 100000 each); searching on the CPU",
        match.from, match.to, frames[match.from].points.size(), frames[match.to].points.size()));
    return nullptr;
  }
  return gpu;
}

Status match_on_gpu(const std::vector<DynamicFrame>& frames, const std::vector<FrameMatch>& matches,
                    double reach, geometry::VelocityMatcher& gpu, const Work& work,
                    std::vector<Velocities>* out) {
  for (std::size_t first = 0; first < matches.size();) {
    STGS_TRY(work.check());
    const std::size_t end = problem_end(frames, matches, first);
    ProblemBuilder builder(frames, frames[matches[0].from].points[0].position, reach);
    for (std::size_t k = first; k < end; ++k) builder.add(matches[k]);
    STGS_TRY(gpu.run(builder.problem));
    for (std::size_t k = first; k < end; ++k) {
      Velocities& velocities = (*out)[matches[k].from];
      for (std::size_t i = 0; i < velocities.size(); ++i) {
        const math::Vec3 step = builder.problem.pairs[k - first].steps[i];
        velocities[i] = cv::Vec3d(step.x, step.y, step.z) * matches[k].per_frame;
      }
    }
    first = end;
  }
  return {};
}

}  // namespace stgs::encoder::init
