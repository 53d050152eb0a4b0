// SPDX-License-Identifier: Apache-2.0
// Velocities from nearest neighbours on the CPU, and the problems that a GPU gets.
#include <algorithm>
#include <functional>

#include "catch_runner.h"
#include "init/velocity_gpu.h"
#include "velocity_scene.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

using geometry::MatchPoint;
using geometry::NearestPoints;

std::vector<MatchPoint> match_points(const DynamicFrame& frame) {
  std::vector<MatchPoint> out;
  for (const SurfacePoint& p : frame.points) {
    const cv::Vec3f at = p.position - kStart;
    out.push_back(
        {at[0], at[1], at[2], float(p.colour[0]), float(p.colour[1]), float(p.colour[2])});
  }
  return out;
}

template <int kCount>
NearestPoints<kCount> nearest(const std::vector<MatchPoint>& points, const MatchPoint& query,
                              double colour) {
  NearestPoints<kCount> out = geometry::no_points<kCount>();
  const double weight = colour * kReach / 255;
  for (std::size_t i = 0; i < points.size(); ++i) {
    add_point(out, geometry::squared_distance(query, points[i], float(weight * weight)), int(i));
  }
  return out;
}

// One round of velocity_rule.h in single precision, by comparison of all points.
Velocities plain_round(const DynamicFrame& frame, const DynamicFrame& next, const Velocities& steps,
                       int round) {
  const std::vector<MatchPoint> from = match_points(frame), to = match_points(next);
  Velocities raw(steps.size(), kUnknown), out = raw;
  for (std::size_t i = 0; i < from.size(); ++i) {
    MatchPoint query = from[i];
    if (known(steps[i])) {
      query.x += float(steps[i][0]);
      query.y += float(steps[i][1]);
      query.z += float(steps[i][2]);
    }
    cv::Vec3d sum(0, 0, 0);
    int n = 0;
    const auto near = nearest<geometry::kMatchedPoints>(to, query, geometry::kMatchColour);
    for (const int k : near.index) {
      if (k < 0) continue;
      const cv::Vec3d step = next.points[k].position - frame.points[i].position;
      if (cv::norm(step) <= kReach) sum += step, ++n;
    }
    if (n > 0) raw[i] = sum * (1.0 / n);
  }
  for (std::size_t i = 0; i < from.size(); ++i) {
    const auto near = nearest<geometry::kWideNeighbours>(from, from[i], geometry::kSmoothColour);
    std::vector<double> parts[3];
    for (int k = 0; k < geometry::smoothing_neighbours(round) && near.index[k] >= 0; ++k) {
      const cv::Vec3d& v = raw[near.index[k]];
      if (near.squared[k] > kReach * kReach || !known(v)) continue;
      for (int d = 0; d < 3; ++d) parts[d].push_back(v[d]);
    }
    if (int(parts[0].size()) < geometry::kMinForMedian) continue;
    for (int d = 0; d < 3; ++d) {
      std::sort(parts[d].begin(), parts[d].end());
      out[i][d] = parts[d][parts[d].size() / 2];
    }
  }
  return out;
}

// Stands for a GPU: the step of a point is to the point of the same index.
class FakeGpu final : public geometry::VelocityMatcher {
 public:
  std::string name() const override { return "fake"; }
  Status run(geometry::VelocityProblem& problem) override {
    ++problems;
    geometry::PairCost sum;
    for (geometry::FramePair& pair : problem.pairs) {
      const std::vector<MatchPoint>& from = problem.frames[pair.from];
      const std::vector<MatchPoint>& to = problem.frames[pair.to];
      const geometry::PairCost cost = geometry::pair_cost(from.size(), to.size());
      sum = {sum.comparisons + cost.comparisons, sum.bytes + cost.bytes};
      for (std::size_t i = 0; i < from.size(); ++i) {
        const MatchPoint a = from[i], b = to[std::min(i, to.size() - 1)];
        pair.steps.push_back({b.x - a.x, b.y - a.y, b.z - a.z});
      }
    }
    exceeded = exceeded || sum.comparisons > geometry::kMaxProblemCost.comparisons ||
               sum.bytes > geometry::kMaxProblemCost.bytes ||
               problem.pairs.size() > geometry::kMaxProblemPairs;
    if (after_run) after_run();
    return {};
  }

  std::function<void()> after_run;
  int problems = 0;
  bool exceeded = false;  // whether a problem was larger than the limits
};

// Checks the steps of a FakeGpu.
void check_steps(const std::vector<DynamicFrame>& frames, const std::vector<Velocities>& found) {
  std::size_t wrong = 0;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const bool is_last = k + 1 == frames.size();
    const std::vector<SurfacePoint>& next = frames[is_last ? k - 1 : k + 1].points;
    for (std::size_t i = 0; i < found[k].size(); ++i) {
      const cv::Vec3d step =
          next[std::min(i, next.size() - 1)].position - frames[k].points[i].position;
      wrong += cv::norm(found[k][i] - (is_last ? -1.0 : 1.0) * step) < 1e-4 ? 0 : 1;
    }
  }
  CHECK(wrong == 0);
}

}  // namespace

TEST_CASE("velocities are those of a turning ellipsoid, also in the last frame") {
  const std::vector<DynamicFrame> frames = ellipsoids({3000, 3000, 3000});
  const std::vector<Velocities> found = matched(frames, 1, nullptr);
  for (int frame = 0; frame < 3; ++frame) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < found[frame].size(); ++i) {
      // The point at rest, and its true velocity between the frames that are compared.
      const double start = frame < 2 ? frame : 1;
      cv::Vec3d p = frames[frame].points[i].position - kStart - double(frame) * kShift;
      const double c = std::cos(kTurn * frame), s = std::sin(kTurn * frame);
      p = {c * p[0] - s * p[2], p[1], c * p[2] + s * p[0]};
      errors.push_back(cv::norm(found[frame][i] - (moved(p, start + 1) - moved(p, start))));
    }
    std::nth_element(errors.begin(), errors.begin() + 1500, errors.end());
    INFO("frame " << frame);
    CHECK(errors[1500] < 0.4 * cv::norm(kShift));
  }
}

TEST_CASE("velocities are per frame if frames are matched over an interval") {
  std::vector<DynamicFrame> frames = ellipsoids({800, 0, 800, 0});
  const std::vector<Velocities> found = matched(frames, 2, nullptr);
  cv::Vec3d mean(0, 0, 0);
  for (const cv::Vec3d& velocity : found[0]) mean += velocity * (1.0 / 800);
  CHECK(cv::norm(mean - kShift) < 0.3 * cv::norm(kShift));
}

TEST_CASE("velocities of few points and of frames without a partner are zero") {
  const std::vector<DynamicFrame> frames = ellipsoids({1, 2, 0, 40});
  for (const Velocities& velocities : matched(frames, 1, nullptr))
    for (const cv::Vec3d& velocity : velocities) CHECK(velocity == cv::Vec3d(0, 0, 0));
}

TEST_CASE("velocities follow the rule that the CPU and CUDA share") {
  for (const int count : {2, 3, 20, 300}) {
    const DynamicFrame frame = ellipsoid(count, 0), next = ellipsoid(count + 5, 1);
    Velocities expected(frame.points.size(), kUnknown);
    for (int round = 0; round < geometry::kMatchRounds; ++round)
      expected = plain_round(frame, next, expected, round);
    const Velocities found = match_velocities(frame.points, next.points, kReach);
    INFO(count << " points");
    CHECK(different(fill_unknown(expected, expected), fill_unknown(found, found)) == 0);
  }
}

TEST_CASE("a GPU gets problems within the limits, and its velocities are those of their frames") {
  // Limited by the pairs, by the memory and by the comparisons.
  for (const auto& [count, points] : {std::pair{5000, 2}, {1700, 1000}, {13, 30000}}) {
    std::vector<int> counts(count, points);
    counts[2] += 1;
    const std::vector<DynamicFrame> frames = ellipsoids(counts);
    FakeGpu gpu;
    const std::vector<Velocities> found = matched(frames, 1, &gpu);
    INFO(count << " frames");
    CHECK(gpu.problems == 2);
    CHECK(!gpu.exceeded);
    check_steps(frames, found);
  }
}

TEST_CASE("velocities on a GPU are cancelled between problems") {
  const std::vector<DynamicFrame> frames = ellipsoids(std::vector<int>(9000, 2));
  const ProgressSink progress;
  const LogSink log;
  Work work(progress, log);
  work.stage("velocities");
  FakeGpu gpu;
  gpu.after_run = [&] { work.cancel(); };
  std::vector<Velocities> out;
  const Status status = match_frames(frames, 1, kReach, &gpu, work, &out);
  CHECK(status.message() == "velocities: cancelled");
  CHECK(gpu.problems == 1);
}

TEST_CASE("frames with too many points for a GPU are left to the CPU, with a reason") {
  std::string logged;
  const ProgressSink progress;
  const LogSink log = [&](int, const std::string& line) { logged += line; };
  const Work work(progress, log);
  std::vector<DynamicFrame> frames(3);
  for (DynamicFrame& frame : frames) frame.points.resize(100000);
  FakeGpu gpu;
  CHECK(gpu_within_limits(nullptr, frames, 1, work) == nullptr);
  CHECK(gpu_within_limits(&gpu, frames, 1, work) == &gpu);
  CHECK(logged.empty());
  frames[2].points.resize(100001);
  CHECK(gpu_within_limits(&gpu, frames, 1, work) == nullptr);
  CHECK(logged.find("frames 1 and 2 have 100000 and 100001 points") != std::string::npos);
  CHECK(logged.find("on the CPU") != std::string::npos);
}
