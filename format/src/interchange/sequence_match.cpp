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

// Bounds of the first step of a run, which determines its velocity.
constexpr double kMaxOrderedStep = 32;  // in largest standard deviations, for files in one order
constexpr double kMaxNearbyStep = 4;    // in typical largest standard deviations, otherwise
constexpr int kMaxRounds = 4;           // of resolving conflicts between splats
constexpr int kMaxCandidates = 4096;    // runs considered per splat
// Relative rounding error of binary32 positions.
constexpr double kRounding = 4.0 / (1 << 23);
// Greatest |Y| of each degree: sqrt((2 l + 1) / (4 pi)).
constexpr double kShBound[4] = {0.28209480, 0.48860252, 0.63078314, 0.74635267};

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

// Returns the median standard deviations over about a thousand splats.
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

// Returns the greatest difference of a colour channel over all directions.
double colour_difference(const float* a, const float* b, int sh_degree) {
  std::array<double, 3> sum{};
  for (int l = 0, k = 0; l <= sh_degree; ++l) {
    for (; k < (l + 1) * (l + 1); ++k) {
      for (int c = 0; c < 3; ++c) {
        sum[static_cast<std::size_t>(c)] +=
            kShBound[l] * std::abs(double{a[3 * k + c]} - b[3 * k + c]);
      }
    }
  }
  return *std::max_element(sum.begin(), sum.end());
}

void update_max(SequenceTolerances& a, const SequenceTolerances& b) {
  a.position = std::max(a.position, b.position);
  a.log_scale = std::max(a.log_scale, b.log_scale);
  a.rotation = std::max(a.rotation, b.rotation);
  a.opacity = std::max(a.opacity, b.opacity);
  a.colour = std::max(a.colour, b.colour);
}

// A spatial hash of points.
class Grid {
 public:
  // `cell`: edge of a cell; 0 puts all points but those at the origin into the outermost cells.
  explicit Grid(double cell) : inverse_(cell > 0 ? 1 / cell : std::numeric_limits<double>::max()) {}

  void add(const std::array<double, 3>& point, std::uint32_t id) {
    points_.emplace_back(key(cell_of(point)), id);
  }
  void finish() { std::sort(points_.begin(), points_.end()); }

  // Calls visit(id) for the points in the cell of a point and its neighbours, until it returns
  // false.
  template <typename Visit>
  void visit_near(const std::array<double, 3>& point, const Visit& visit) const {
    const Cell centre = cell_of(point);
    for (std::int64_t x = -1; x <= 1; ++x) {
      for (std::int64_t y = -1; y <= 1; ++y) {
        // Cells that differ only in z have consecutive keys.
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
  static constexpr double kEdge = 1 << 20;  // points farther away share a cell

  Cell cell_of(const std::array<double, 3>& point) const {
    Cell cell;
    for (std::size_t c = 0; c < 3; ++c) {
      // A point that the float range cannot express may be NaN: it gets the lowest cell.
      const double place = std::fmax(std::floor(point[c] * inverse_), -kEdge + 2);
      cell[c] = static_cast<std::int64_t>(std::fmin(place, kEdge - 3));
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
    for (std::size_t c = 0; c < 3; ++c)
      p[c] += age(run) * (run.min_velocity[c] + run.max_velocity[c]) / 2;
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
                                double max_step, Step& step) const {
  const std::array<double, 3> first = position_of(set_, run.primitive);
  const std::array<double, 3> now = position_of(frame, splat), guess = expected(run);
  const double frames = age(run);
  step.run = run;
  double moved = 0, surprise = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double d = now[c] - first[c];
    // The tolerance is a radius; each axis gets a third of its square.
    const double slack = run.tolerance * std::sqrt(1.0 / 3) +
                         kRounding * std::max(std::abs(now[c]), std::abs(first[c]));
    const double low = (d - slack) / frames, high = (d + slack) / frames;
    step.run.min_velocity[c] = frames > 1 ? std::max(run.min_velocity[c], low) : low;
    step.run.max_velocity[c] = frames > 1 ? std::min(run.max_velocity[c], high) : high;
    if (step.run.min_velocity[c] > step.run.max_velocity[c]) return false;
    moved += d * d;
    surprise += (now[c] - guess[c]) * (now[c] - guess[c]);
  }
  step.surprise = std::sqrt(surprise);
  step.run.farthest = std::max(run.farthest, std::sqrt(moved));
  if (frames <= 1 && step.surprise > std::max(max_step, run.tolerance)) return false;
  return same_attributes(frame, splat, run.primitive, step.difference);
}

void SequenceMatcher::assign(std::size_t splat, std::size_t run, const Step& step) {
  next_[splat] = step.run;
  splat_done_[splat] = 1;
  run_done_[run] = 1;
}

// Matches splats by position in the list: a tool usually keeps the order of splats.
std::size_t SequenceMatcher::match_in_order(const Gaussians4D& frame) {
  const std::size_t both = std::min(frame.size(), runs_.size());
  parallel_blocks(
      std::size_t{0}, both, kPrimitivesPerTask, [&](std::size_t begin, std::size_t end) {
        Step step;
        for (std::size_t i = begin; i < end; ++i) {
          const double max_step = kMaxOrderedStep * sizes_of(set_, runs_[i].primitive).largest;
          if (continues(frame, i, runs_[i], max_step, step)) assign(i, i, step);
        }
      });
  return static_cast<std::size_t>(
      std::count(splat_done_.begin(), splat_done_.end(), std::uint8_t{1}));
}

// Assigns each remaining splat to the remaining run that it continues with the smallest surprise.
// If several splats choose the same run, the first one gets it and the others choose again.
// `starting`: only considers runs whose velocity is unknown.
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
  std::vector<std::optional<std::pair<std::uint32_t, Step>>> choice(left.size());
  for (int round = 0; round < kMaxRounds && !left.empty(); ++round) {
    parallel_blocks(std::size_t{0}, left.size(), kPrimitivesPerTask,
                    [&](std::size_t begin, std::size_t end) {
                      for (std::size_t w = begin; w < end; ++w) {
                        choice[w].reset();
                        int looked_at = 0;
                        grid.visit_near(position_of(frame, left[w]), [&](std::uint32_t r) {
                          Step step;
                          if (!run_done_[r] && continues(frame, left[w], runs_[r], cell, step) &&
                              (!choice[w] || step.surprise < choice[w]->second.surprise)) {
                            choice[w].emplace(r, step);
                          }
                          return ++looked_at < kMaxCandidates;
                        });
                      }
                    });
    std::vector<std::uint32_t> again;
    for (std::size_t w = 0; w < left.size(); ++w) {
      if (!choice[w]) continue;
      if (run_done_[choice[w]->first]) {
        again.push_back(left[w]);
      } else {
        assign(left[w], choice[w]->first, choice[w]->second);
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
  const double frames = age(run);  // length of the run, without the frame being added
  set_.radius[run.primitive] = static_cast<float>(frames);
  float* velocity = set_.velocity.data() + std::size_t{3} * run.primitive;
  std::fill_n(velocity, 3, 0.0f);
  if (frames < 2) return;
  bool is_static = run.farthest <= run.tolerance;
  for (std::size_t c = 0; c < 3; ++c)
    is_static &= run.min_velocity[c] <= 0 && run.max_velocity[c] >= 0;
  if (!is_static) {
    for (std::size_t c = 0; c < 3; ++c) {
      velocity[c] = static_cast<float>((run.min_velocity[c] + run.max_velocity[c]) / 2);
    }
    ++report_.moving;
  }
  const double error = is_static ? run.farthest : run.tolerance;
  report_.position_error = std::max(report_.position_error, error);
  report_.errors.position =
      std::max(report_.errors.position, error / sizes_of(set_, run.primitive).middle);
}

void SequenceMatcher::match_by_place(const Gaussians4D& frame) {
  if (2 * match_in_order(frame) < std::min(runs_.size(), frame.size())) {
    // The order differs: the matches found are coincidental.
    splat_done_.assign(frame.size(), 0);
    run_done_.assign(runs_.size(), 0);
  }
  const Sizes sizes = typical_sizes(frame);
  match_nearby(frame, sizes.middle, false);
  match_nearby(frame, kMaxNearbyStep * sizes.largest, true);
}

void SequenceMatcher::match_by_identity(const Gaussians4D& frame,
                                        std::span<const std::uint32_t> ids) {
  Step step;
  for (std::size_t i = 0, r = 0; i < ids.size() && r < ids_.size();) {
    if (ids[i] < ids_[r]) {
      ++i;
    } else if (ids[i] > ids_[r]) {
      ++r;
    } else {
      const double any_step = std::numeric_limits<double>::infinity();
      if (continues(frame, i, runs_[r], any_step, step)) assign(i, r, step);
      ++i;
      ++r;
    }
  }
}

Status SequenceMatcher::add(const Gaussians4D& frame, std::span<const std::uint32_t> ids) {
  // Lists that grow take up to three times their entries. A splat has a choice with its run,
  // and an index in two lists; a run is a point of the grid.
  constexpr std::uint64_t kPerSplat =
      sizeof(std::optional<std::pair<std::uint32_t, Step>>) + 2 * 3 * sizeof(std::uint32_t) + 2;
  constexpr std::uint64_t kPerRun = 3 * sizeof(std::pair<std::uint64_t, std::uint32_t>) + 1;
  const std::uint64_t runs = std::max(runs_.size(), frame.size());
  STGS_TRY(memory_.grow(runs_lease_, runs * (2 * sizeof(Run) + sizeof(std::uint32_t)),
                        "the runs of a sequence"));
  STGS_ASSIGN(const Lease lease, memory_.take(frame.size() * kPerSplat + runs_.size() * kPerRun,
                                              "the splats being matched"));
  if (frames_ == 0) set_.sh_degree = frame.sh_degree;
  next_ = {};  // an assignment would keep the old array while the new one is filled
  next_.assign(frame.size(), {});
  splat_done_.assign(frame.size(), 0);
  run_done_.assign(runs_.size(), 0);
  if (!runs_.empty() && frame.size() > 0) {
    if (ids.empty()) {
      match_by_place(frame);
    } else {
      match_by_identity(frame, ids);
    }
  }
  ids_ = {};
  ids_.assign(ids.begin(), ids.end());
  for (std::size_t r = 0; r < runs_.size(); ++r) {
    if (!run_done_[r]) end_run(runs_[r]);
  }
  const auto born = std::count(splat_done_.begin(), splat_done_.end(), std::uint8_t{0});
  STGS_TRY(memory_.reserve(set_, set_lease_, set_.size() + static_cast<std::uint64_t>(born)));
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (!splat_done_[i]) {
      begin_run(frame, i);
    } else {
      SequenceTolerances difference;
      same_attributes(frame, i, next_[i].primitive, difference);
      update_max(report_.errors, difference);
    }
  }
  runs_.swap(next_);
  ++frames_;
  report_.splats += frame.size();
  return {};
}

Gaussians4D SequenceMatcher::finish(SequenceReport& report) {
  for (const Run& run : runs_) end_run(run);
  runs_.clear();
  report_.frames = frames_;
  report_.primitives = set_.size();
  const double clip = frames_;
  for (std::size_t i = 0; i < set_.size(); ++i) {
    const double first = set_.time[i], last = first + double{set_.radius[i]} - 1;
    double begin = first - 0.5, end = last + 0.5 - kEdgeWidth;
    double sigma = kEdgeSigma;
    if (first == 0 && last == clip - 1) {
      // Same lifespan as set_static_lifespan(), so that a static model is stored as such.
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
