// SPDX-License-Identifier: Apache-2.0
#include "interchange/sequence_match.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "interchange/import.h"
#include "interchange/rotation_angle.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kGrain = 4096;
// A run's first step shows its velocity, so nothing bounds it but these.
constexpr double kWidestStep = 32;  // largest standard deviations, where the order agrees
constexpr double kNearStep = 4;     // typical largest standard deviations, where it does not
constexpr int kRounds = 4;          // of splats that want the same run
// Of one splat; what lies denser than this in one place is not all looked at.
constexpr int kMostCandidates = 4096;
// Lifespans end this softly, in frames; where they meet, one fades while the other is there.
constexpr double kFade = 1.0 / 1024;
constexpr double kFadeWidth = 2.3541 * kFade;  // sigma sqrt(ln 255): where even O = 1 is not drawn
// Positions are binary32: a straight run strays by its rounding.
constexpr double kRounding = 4.0 / (1 << 23);
// Greatest |Y| of each degree: sqrt((2 l + 1) / (4 pi)).
constexpr double kHarmonicBound[4] = {0.28209480, 0.48860252, 0.63078314, 0.74635267};

double sigmoid(double x) {
  return 1 / (1 + std::exp(-x));
}

struct Sizes {
  double middle, largest;  // standard deviations, scene units
};

Sizes sizes_of(const Gaussians4D& set, std::size_t i) {
  std::array<float, 3> s;
  std::copy_n(set.log_scale.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, s.begin());
  std::sort(s.begin(), s.end());
  return {std::exp(double{s[1]}), std::exp(double{s[2]})};
}

// The middle one over a thousand splats of their standard deviations.
Sizes typical_sizes(const Gaussians4D& set) {
  std::vector<double> middle, largest;
  for (std::size_t i = 0; i < set.size(); i += 1 + set.size() / 1000) {
    const Sizes sizes = sizes_of(set, i);
    middle.push_back(sizes.middle);
    largest.push_back(sizes.largest);
  }
  const auto median = [](std::vector<double>& values) {
    const auto mid = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), mid, values.end());
    return *mid;
  };
  return {median(middle), median(largest)};
}

// Greatest difference of a channel of the colour, from any direction.
double colour_difference(const float* a, const float* b, int sh_degree) {
  std::array<double, 3> sum{};
  for (int l = 0, k = 0; l <= sh_degree; ++l) {
    for (; k < (l + 1) * (l + 1); ++k) {
      for (int c = 0; c < 3; ++c) {
        sum[static_cast<std::size_t>(c)] +=
            kHarmonicBound[l] * std::abs(double{a[3 * k + c]} - b[3 * k + c]);
      }
    }
  }
  return *std::max_element(sum.begin(), sum.end());
}

void keep_larger(SequenceTolerances& a, const SequenceTolerances& b) {
  a.position = std::max(a.position, b.position);
  a.log_scale = std::max(a.log_scale, b.log_scale);
  a.rotation = std::max(a.rotation, b.rotation);
  a.opacity = std::max(a.opacity, b.opacity);
  a.colour = std::max(a.colour, b.colour);
}

// Points in cubes of space, found by the cube.
class Grid {
 public:
  explicit Grid(double cell) : inverse_(1 / cell) {}

  void add(const std::array<double, 3>& point, std::uint32_t id) {
    points_.emplace_back(key(cell_of(point)), id);
  }
  void finish() { std::sort(points_.begin(), points_.end()); }

  // visit(id) for what lies in the cube of the point and those around it, until it gives false.
  template <typename Visit>
  void near(const std::array<double, 3>& point, const Visit& visit) const {
    const Cell centre = cell_of(point);
    for (std::int64_t x = -1; x <= 1; ++x) {
      for (std::int64_t y = -1; y <= 1; ++y) {
        // Cubes that differ in z alone have keys one after the other.
        const std::uint64_t first = key({centre[0] + x, centre[1] + y, centre[2] - 1});
        auto it = std::lower_bound(points_.begin(), points_.end(), std::pair(first, 0u));
        for (; it != points_.end() && it->first <= first + 2; ++it) {
          if (!visit(it->second)) return;
        }
      }
    }
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  static constexpr double kEdge = 1 << 20;  // farther cubes share one

  Cell cell_of(const std::array<double, 3>& point) const {
    Cell cell;
    for (std::size_t c = 0; c < 3; ++c) {
      cell[c] = static_cast<std::int64_t>(
          std::clamp(std::floor(point[c] * inverse_), -kEdge + 2, kEdge - 3));
    }
    return cell;
  }
  static std::uint64_t key(const Cell& cell) {
    std::uint64_t out = 0;
    for (std::int64_t c : cell) out = out << 21 | static_cast<std::uint64_t>(c + (1 << 20));
    return out;
  }

  double inverse_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> points_;
};

std::array<double, 3> position_of(const Gaussians4D& set, std::size_t i) {
  return {set.position[3 * i], set.position[3 * i + 1], set.position[3 * i + 2]};
}

}  // namespace

double SequenceMatcher::age(const Run& run) const {
  return static_cast<double>(frames_) - double{set_.time[run.primitive]};
}

std::array<double, 3> SequenceMatcher::expected(const Run& run) const {
  std::array<double, 3> p = position_of(set_, run.primitive);
  if (age(run) > 1) {
    for (std::size_t c = 0; c < 3; ++c) p[c] += age(run) * (run.least[c] + run.greatest[c]) / 2;
  }
  return p;
}

bool SequenceMatcher::same_attributes(const Gaussians4D& frame, std::size_t splat,
                                      std::uint32_t primitive,
                                      SequenceTolerances& difference) const {
  difference = {0, 0, 0, 0, 0};
  const float a = frame.opacity_logit[splat], b = set_.opacity_logit[primitive];
  if (a != b) difference.opacity = std::abs(sigmoid(a) - sigmoid(b));
  if (difference.opacity > tolerances_.opacity) return false;
  for (std::size_t c = 0; c < 3; ++c) {
    const double d = double{frame.log_scale[3 * splat + c]} - set_.log_scale[3 * primitive + c];
    difference.log_scale = std::max(difference.log_scale, std::abs(d));
  }
  if (difference.log_scale > tolerances_.log_scale) return false;
  const auto stride = 3 * static_cast<std::size_t>(set_.sh_coefficients());
  difference.colour = colour_difference(frame.sh.data() + stride * splat,
                                        set_.sh.data() + stride * primitive, set_.sh_degree);
  if (difference.colour > tolerances_.colour) return false;
  const float* q = frame.rotation.data() + 4 * splat;
  const float* p = set_.rotation.data() + std::size_t{4} * primitive;
  if (!std::equal(q, q + 4, p)) {
    const Sizes sizes = sizes_of(set_, primitive);
    difference.rotation = rotation_angle(q, p) * sizes.largest / sizes.middle;
  }
  return difference.rotation <= tolerances_.rotation;
}

bool SequenceMatcher::continues(const Gaussians4D& frame, std::size_t splat, const Run& run,
                                double widest, Step& step) const {
  const std::array<double, 3> first = position_of(set_, run.primitive);
  const std::array<double, 3> now = position_of(frame, splat), guess = expected(run);
  const double frames = age(run);
  step.run = run;
  double moved = 0, surprise = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double d = now[c] - first[c];
    // The tolerance is a radius; a third of its square for each axis.
    const double slack = run.tolerance * std::sqrt(1.0 / 3) +
                         kRounding * std::max(std::abs(now[c]), std::abs(first[c]));
    const double least = (d - slack) / frames, greatest = (d + slack) / frames;
    step.run.least[c] = frames > 1 ? std::max(run.least[c], least) : least;
    step.run.greatest[c] = frames > 1 ? std::min(run.greatest[c], greatest) : greatest;
    if (step.run.least[c] > step.run.greatest[c]) return false;
    moved += d * d;
    surprise += (now[c] - guess[c]) * (now[c] - guess[c]);
  }
  step.surprise = std::sqrt(surprise);
  step.run.farthest = std::max(run.farthest, std::sqrt(moved));
  if (frames <= 1 && step.surprise > std::max(widest, run.tolerance)) return false;
  return same_attributes(frame, splat, run.primitive, step.difference);
}

void SequenceMatcher::take(std::size_t splat, std::size_t run, const Step& step) {
  next_[splat] = step.run;
  splat_done_[splat] = 1;
  run_done_[run] = 1;
}

// Files of one tool mostly list the splats in one order.
std::size_t SequenceMatcher::match_in_order(const Gaussians4D& frame) {
  const std::size_t both = std::min(frame.size(), runs_.size());
  parallel_blocks(std::size_t{0}, both, kGrain, [&](std::size_t begin, std::size_t end) {
    Step step;
    for (std::size_t i = begin; i < end; ++i) {
      const double widest = kWidestStep * sizes_of(set_, runs_[i].primitive).largest;
      if (continues(frame, i, runs_[i], widest, step)) take(i, i, step);
    }
  });
  return static_cast<std::size_t>(
      std::count(splat_done_.begin(), splat_done_.end(), std::uint8_t{1}));
}

// Each splat that is left takes, of the runs that are left and that it continues, the one that was
// expected nearest to it; of splats that want the same run the first has it, and the others look
// again. `starting`: only runs whose velocity is not known.
void SequenceMatcher::match_nearby(const Gaussians4D& frame, double cell, bool starting) {
  Grid grid(cell);
  for (std::size_t r = 0; r < runs_.size(); ++r) {
    if (run_done_[r] || (starting && age(runs_[r]) > 1)) continue;
    grid.add(expected(runs_[r]), static_cast<std::uint32_t>(r));
  }
  grid.finish();
  std::vector<std::uint32_t> left;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (!splat_done_[i]) left.push_back(static_cast<std::uint32_t>(i));
  }
  std::vector<std::optional<std::pair<std::uint32_t, Step>>> wish(left.size());
  for (int round = 0; round < kRounds && !left.empty(); ++round) {
    parallel_blocks(std::size_t{0}, left.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t w = begin; w < end; ++w) {
        wish[w].reset();
        int looked_at = 0;
        grid.near(position_of(frame, left[w]), [&](std::uint32_t r) {
          Step step;
          if (!run_done_[r] && continues(frame, left[w], runs_[r], cell, step) &&
              (!wish[w] || step.surprise < wish[w]->second.surprise)) {
            wish[w].emplace(r, step);
          }
          return ++looked_at < kMostCandidates;
        });
      }
    });
    std::vector<std::uint32_t> again;
    for (std::size_t w = 0; w < left.size(); ++w) {
      if (!wish[w]) continue;
      if (run_done_[wish[w]->first]) {
        again.push_back(left[w]);
      } else {
        take(left[w], wish[w]->first, wish[w]->second);
      }
    }
    left = std::move(again);
  }
}

void SequenceMatcher::begin_run(const Gaussians4D& frame, std::size_t splat) {
  Run run;
  run.primitive = static_cast<std::uint32_t>(set_.size());
  run.tolerance = tolerances_.position * sizes_of(frame, splat).middle;
  set_.append(frame, splat);
  set_.time.back() = static_cast<float>(frames_);
  next_[splat] = run;
}

void SequenceMatcher::end_run(const Run& run) {
  const double frames = age(run);  // of the run: the frame being added has no part in it
  set_.radius[run.primitive] = static_cast<float>(frames);
  float* velocity = set_.velocity.data() + std::size_t{3} * run.primitive;
  std::fill_n(velocity, 3, 0.0f);
  if (frames < 2) return;
  bool still = run.farthest <= run.tolerance;
  for (std::size_t c = 0; c < 3; ++c) still &= run.least[c] <= 0 && run.greatest[c] >= 0;
  if (!still) {
    for (std::size_t c = 0; c < 3; ++c) {
      velocity[c] = static_cast<float>((run.least[c] + run.greatest[c]) / 2);
    }
    ++report_.moving;
  }
  const double error = still ? run.farthest : run.tolerance;
  report_.position_error = std::max(report_.position_error, error);
  report_.errors.position =
      std::max(report_.errors.position, error / sizes_of(set_, run.primitive).middle);
}

void SequenceMatcher::add(const Gaussians4D& frame) {
  if (frames_ == 0) set_.sh_degree = frame.sh_degree;
  next_.assign(frame.size(), {});
  splat_done_.assign(frame.size(), 0);
  run_done_.assign(runs_.size(), 0);
  if (!runs_.empty() && frame.size() > 0) {
    if (2 * match_in_order(frame) < std::min(runs_.size(), frame.size())) {
      // Another order: what agrees with this one does so by chance.
      splat_done_.assign(frame.size(), 0);
      run_done_.assign(runs_.size(), 0);
    }
    const Sizes sizes = typical_sizes(frame);
    match_nearby(frame, sizes.middle, false);
    match_nearby(frame, kNearStep * sizes.largest, true);
  }
  for (std::size_t r = 0; r < runs_.size(); ++r) {
    if (!run_done_[r]) end_run(runs_[r]);
  }
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (!splat_done_[i]) {
      begin_run(frame, i);
    } else {
      SequenceTolerances difference;
      same_attributes(frame, i, next_[i].primitive, difference);
      keep_larger(report_.errors, difference);
    }
  }
  runs_.swap(next_);
  ++frames_;
  report_.splats += frame.size();
}

Gaussians4D SequenceMatcher::finish(SequenceReport& report) {
  for (const Run& run : runs_) end_run(run);
  runs_.clear();
  report_.frames = frames_;
  report_.primitives = set_.size();
  const double clip = frames_;
  for (std::size_t i = 0; i < set_.size(); ++i) {
    const double first = set_.time[i], last = first + double{set_.radius[i]} - 1;
    double begin = first - 0.5, end = last + 0.5 - kFadeWidth;
    double sigma = kFade;
    if (first == 0 && last == clip - 1) {
      // As set_static_lifespan has it, so that a model that does not change is stored as one.
      begin = -clip / 2;
      end = 3 * clip / 2;
      sigma = 1;
      ++report_.whole_clip;
    } else if (last == clip - 1) {
      end = clip + 0.5;  // the last frame lasts to the end of the clip
    }
    const double time = (begin + end) / 2;
    for (std::size_t c = 0; c < 3; ++c) {
      set_.position[3 * i + c] = static_cast<float>(
          set_.position[3 * i + c] + double{set_.velocity[3 * i + c]} * (time - first));
    }
    set_.time[i] = static_cast<float>(time);
    set_.radius[i] = static_cast<float>((end - begin) / 2);
    set_.sigma[i] = static_cast<float>(sigma);
  }
  report = report_;
  return std::move(set_);
}

}  // namespace stgs
