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

// Matches for a GPU, with the frames that they use.
class MatchProblem {
 public:
  MatchProblem(const std::vector<DynamicFrame>& frames, const cv::Vec3d& origin, double reach)
      : frames_(frames), origin_(origin) {
    problem_.reach = reach;
  }

  // Adds a match; returns false if that would exceed a limit of a problem. The first always fits.
  bool add(const FrameMatch& match) {
    const PairCost cost = cost_of(frames_, match);
    const PairCost sum{sum_.comparisons + cost.comparisons, sum_.bytes + cost.bytes};
    const bool fits = is_within_limits(sum) && problem_.pairs.size() < geometry::kMaxProblemPairs;
    if (!fits && !problem_.pairs.empty()) return false;
    sum_ = sum;
    const std::size_t from = add_frame(match.from), to = add_frame(match.to);
    problem_.pairs.push_back({from, to});
    return true;
  }
  VelocityProblem& problem() { return problem_; }

 private:
  std::size_t add_frame(int frame) {
    const auto [at, is_new] = added_.try_emplace(frame, problem_.frames.size());
    if (is_new) problem_.frames.push_back(match_points(frames_[frame].points, origin_));
    return at->second;
  }

  const std::vector<DynamicFrame>& frames_;
  const cv::Vec3d origin_;
  VelocityProblem problem_;
  std::map<int, std::size_t> added_;  // index in the problem of each frame
  PairCost sum_;
};

void take_steps(const geometry::FramePair& pair, const FrameMatch& match,
                std::vector<Velocities>* out) {
  Velocities& velocities = (*out)[match.from];
  for (std::size_t i = 0; i < velocities.size(); ++i) {
    const math::Vec3 step = pair.steps[i];
    velocities[i] = cv::Vec3d(step.x, step.y, step.z) * match.per_frame;
  }
}

}  // namespace

geometry::VelocityMatcher* gpu_within_limits(geometry::VelocityMatcher* gpu,
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
  for (std::size_t next = 0; next < matches.size();) {
    STGS_TRY(work.check());
    const std::size_t first = next;
    MatchProblem batch(frames, frames[matches[0].from].points[0].position, reach);
    while (next < matches.size() && batch.add(matches[next])) ++next;
    STGS_TRY(gpu.run(batch.problem()));
    for (std::size_t k = first; k < next; ++k)
      take_steps(batch.problem().pairs[k - first], matches[k], out);
  }
  return {};
}

}  // namespace stgs::encoder::init
