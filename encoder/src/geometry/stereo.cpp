// SPDX-License-Identifier: Apache-2.0
#include "geometry/stereo.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <utility>

#include "geometry/stereo_rows.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder::geometry {
namespace {

// Iterations from random planes at half the size. Then passes of one iteration that also compare
// depths, at half the size and at full size.
constexpr int kFirstIterations = 2, kCoarsePasses = 1, kFinePasses = 3;
constexpr int kConsistentStart = 3;    // iterations that changes of planes shrink by
constexpr float kConsistency = 0.05f;  // cost per pixel of reprojection error
constexpr float kMaxCost = 0.5f;
constexpr float kMaxDepthError = 0.01f;        // relative
constexpr float kMaxReprojectionError = 1.5f;  // pixels
constexpr int kRowsPerTask = 16;

// The images of a view at one size.
struct Level {
  StereoView view;  // without sources
  std::vector<std::uint32_t> corners;
  std::vector<float> depth;
};

// Half the size; an odd last row or column is dropped.
StereoView halved(const StereoView& view) {
  StereoView half = view;
  half.width = std::max(1, view.width / 2);
  half.height = std::max(1, view.height / 2);
  for (float* p : {&half.fx, &half.fy, &half.cx, &half.cy}) *p *= 0.5f;
  half.grey.resize(static_cast<std::size_t>(half.width) * half.height);
  for (int y = 0; y < half.height; ++y) {
    for (int x = 0; x < half.width; ++x) {
      const auto at = [&](int dx, int dy) {
        const int px = std::min(2 * x + dx, view.width - 1);
        const int py = std::min(2 * y + dy, view.height - 1);
        return int{view.grey[static_cast<std::size_t>(py) * view.width + px]};
      };
      half.grey[static_cast<std::size_t>(y) * half.width + x] =
          static_cast<std::uint8_t>((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4);
    }
  }
  return half;
}

std::vector<Level> levels_of(const std::vector<StereoView>& views, bool half) {
  std::vector<Level> levels(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    levels[i].view = half ? halved(views[i]) : views[i];
    levels[i].corners =
        corners_of(levels[i].view.grey.data(), levels[i].view.width, levels[i].view.height);
  }
  return levels;
}

StereoImage image_of(const Level& level) {
  const StereoView& v = level.view;
  return {level.corners.data(),
          level.depth.empty() ? nullptr : level.depth.data(),
          v.width,
          v.height,
          v.fx,
          v.fy,
          v.cx,
          v.cy};
}

StereoProblem problem_of(const std::vector<Level>& levels, std::span<const int> sources,
                         std::size_t i, const StereoSettings& settings, float consistency) {
  StereoProblem problem{};
  problem.reference = image_of(levels[i]);
  problem.nearest = settings.nearest;
  problem.farthest = settings.farthest;
  problem.consistency = consistency;
  const StereoView& from = levels[i].view;
  for (const int j : sources.first(std::min<std::size_t>(sources.size(), kMaxSources))) {
    const StereoView& to = levels[static_cast<std::size_t>(j)].view;
    StereoSource& source = problem.sources[problem.source_count++];
    source.image = image_of(levels[static_cast<std::size_t>(j)]);
    source = posed_source(source, from.rotation, from.translation, to.rotation, to.translation);
    source = derived_source(problem.reference, source);
  }
  return problem;
}

class CpuMatcher final : public ViewMatcher {
 public:
  std::string name() const override { return "cpu"; }
  Status run(const ViewPass& pass) override {
    // Threads that have finished their views take rows.
    const auto for_rows = [&pass](const auto& body) {
      parallel_blocks(0, pass.problem.reference.height, kRowsPerTask, [&](int first, int last) {
        for (int y = first; y < last; ++y) body(y);
      });
    };
    if (pass.from_random)
      for_rows([&pass](int y) { start_row(pass.problem, pass.map, y, pass.seed); });
    for (int k = pass.first; k < pass.first + pass.iterations; ++k) {
      for (const int colour : {0, 1})
        for_rows([&](int y) { update_row(pass.problem, pass.map, y, colour, k, pass.seed); });
    }
    return {};
  }
};

// The state of all views at one size.
class Matcher {
 public:
  Matcher(const std::vector<StereoView>& views, const StereoSettings& settings,
          ViewMatcher& matcher, const StereoLoop& loop)
      : views_(views), settings_(settings), matcher_(matcher), loop_(loop) {}

  Status run() {
    levels_ = levels_of(views_, true);
    maps_.resize(views_.size());
    for (std::size_t i = 0; i < views_.size(); ++i) {
      maps_[i].planes.resize(levels_[i].corners.size());
      maps_[i].costs.resize(levels_[i].corners.size());
    }
    STGS_TRY(pass(0, kFirstIterations, 0));
    STGS_TRY(consistent_passes(kCoarsePasses));
    const std::vector<Level> coarse = std::exchange(levels_, levels_of(views_, false));
    for (std::size_t i = 0; i < views_.size(); ++i) upsample(coarse[i].view, i);
    STGS_TRY(consistent_passes(kFinePasses));
    take_depths();
    return confirm();
  }

  std::vector<StereoMap> take() { return std::move(maps_); }

 private:
  // Iterates over all views. Each depends on the others' depths of earlier passes only.
  Status pass(int first, int iterations, float consistency) {
    ++passes_;
    return loop_(static_cast<int>(views_.size()), [&](int i) {
      const auto view = static_cast<std::size_t>(i);
      ViewPass pass;
      pass.problem = problem_at(view, consistency);
      pass.map = {maps_[view].planes.data(), maps_[view].costs.data()};
      pass.seed = settings_.seed + 0x10000 * view + 0x100 * passes_;
      pass.from_random = passes_ == 1;
      pass.first = first;
      pass.iterations = iterations;
      return matcher_.run(pass);
    });
  }

  Status consistent_passes(int count) {
    for (int k = 0; k < count; ++k) {
      take_depths();
      STGS_TRY(pass(kConsistentStart + k, 1, kConsistency));
    }
    return {};
  }

  void take_depths() {
    for (std::size_t i = 0; i < views_.size(); ++i) {
      std::vector<float>& depth = levels_[i].depth;
      depth.resize(maps_[i].planes.size());
      std::transform(maps_[i].planes.begin(), maps_[i].planes.end(), depth.begin(),
                     [](const Hypothesis& plane) { return plane.depth; });
    }
  }

  StereoProblem problem_at(std::size_t i, float consistency) const {
    return problem_of(levels_, views_[i].sources, i, settings_, consistency);
  }

  // Takes the planes and costs of view i from those of half the size.
  void upsample(const StereoView& half, std::size_t i) {
    const StereoProblem problem = problem_at(i, 0);
    const StereoView& view = levels_[i].view;
    std::vector<Hypothesis> planes(levels_[i].corners.size());
    std::vector<float> costs(planes.size());
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const int hx = std::min(x / 2, half.width - 1), hy = std::min(y / 2, half.height - 1);
        const std::size_t from = static_cast<std::size_t>(hy) * half.width + hx;
        const std::size_t to = static_cast<std::size_t>(y) * view.width + x;
        const Hypothesis& plane = maps_[i].planes[from];
        const Hypothesis moved = moved_plane(
            problem, plane, static_cast<float>(2 * hx + 1), static_cast<float>(2 * hy + 1),
            static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
        planes[to] = moved.depth > 0 ? moved : plane;
        costs[to] = maps_[i].costs[from];
      }
    }
    maps_[i].planes = std::move(planes);
    maps_[i].costs = std::move(costs);
  }

  // Counts the views that confirm each plane.
  Status confirm() {
    return loop_(static_cast<int>(views_.size()), [&](int i) -> Status {
      const auto view = static_cast<std::size_t>(i);
      StereoMap& map = maps_[view];
      map.confirmations.assign(map.planes.size(), 0);
      std::vector<int> others(views_.size());
      for (std::size_t j = 0; j < others.size(); ++j) others[j] = static_cast<int>(j);
      others.erase(others.begin() + i);
      const int width = levels_[view].view.width;
      for (std::size_t first = 0; first < others.size(); first += kMaxSources) {
        const StereoProblem problem =
            problem_of(levels_, std::span(others).subspan(first), view, settings_, 0);
        for (std::size_t at = 0; at < map.planes.size(); ++at) {
          if (map.costs[at] > kMaxCost) continue;
          const float u = static_cast<float>(at % width) + 0.5f;
          const float v = static_cast<float>(at / width) + 0.5f;
          map.confirmations[at] = static_cast<std::uint8_t>(std::min(
              255, map.confirmations[at] + confirmed_by(problem, u, v, map.planes[at].depth)));
        }
      }
      for (std::uint8_t& count : map.confirmations) {
        if (count < settings_.needed) count = 0;
      }
      return {};
    });
  }

  // Returns the number of sources that confirm a depth.
  static int confirmed_by(const StereoProblem& problem, float u, float v, float depth) {
    int count = 0;
    for (int k = 0; k < problem.source_count; ++k) {
      const StereoSource& source = problem.sources[k];
      const float error =
          reprojection_error(problem.reference, source, u, v, depth, kMaxReprojectionError);
      if (error >= kMaxReprojectionError) continue;
      const SeenPoint seen = seen_point(problem.reference, source, u, v, depth);
      if (seen.pixel == kNoPixel) continue;
      const float difference = source.image.depth[seen.pixel] - seen.z;
      count += std::abs(difference) <= kMaxDepthError * seen.z ? 1 : 0;
    }
    return count;
  }

  const std::vector<StereoView>& views_;
  const StereoSettings& settings_;
  ViewMatcher& matcher_;
  const StereoLoop& loop_;
  std::vector<Level> levels_;
  std::vector<StereoMap> maps_;
  std::uint64_t passes_ = 0;
};

}  // namespace

std::vector<std::uint32_t> corners_of(const std::uint8_t* grey, int width, int height) {
  std::vector<std::uint32_t> corners(static_cast<std::size_t>(width) * height);
  const auto value = [&](int x, int y) {
    const int px = std::min(x, width - 1), py = std::min(y, height - 1);
    return std::uint32_t{grey[static_cast<std::size_t>(py) * width + px]};
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      corners[static_cast<std::size_t>(y) * width + x] =
          value(x, y) | value(x + 1, y) << 8 | value(x, y + 1) << 16 | value(x + 1, y + 1) << 24;
    }
  }
  return corners;
}

Result<std::vector<StereoMap>> match_views(const std::vector<StereoView>& views,
                                           const StereoSettings& settings, ViewMatcher& matcher,
                                           const StereoLoop& loop) {
  Matcher matching(views, settings, matcher, loop);
  STGS_TRY(matching.run());
  return matching.take();
}

std::unique_ptr<ViewMatcher> make_cpu_matcher() {
  return std::make_unique<CpuMatcher>();
}

}  // namespace stgs::encoder::geometry
