// SPDX-License-Identifier: Apache-2.0
#include "train/initial_state.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nanoflann.hpp>

#include "stgs/encoder/windows.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"
#include "train/checkpoint.h"
#include "train/coupled_state.h"
#include "train/densify.h"
#include "train/foreground.h"
#include "train/initial_points.h"
#include "train/persistence.h"
#include "train/random.h"
#include "train/rig.h"
#include "train/scene_background.h"

namespace stgs::encoder {
namespace {

constexpr double kInitialFraction = 0.6;  // of max_primitives; densification adds the rest
constexpr double kDynamicFraction =
    0.5;  // of the initial primitives, at most, if both kinds are plentiful
constexpr double kChangedPointShare = 0.1;  // of max_primitives: points of changed static content
constexpr int kNeighbours = 3;
constexpr float kFlatness = 0.2f;    // thickness of an initial disc relative to its radius
constexpr float kBeginSigma = 0.5f;  // of static content that begins within a window, frames
constexpr double kFarShare = 0.01;   // of the initial primitives: there is a far background
// Of the static points and the background, which do not depend on the seed of the run.
constexpr std::uint64_t kSharedSeed = 0;

struct PointView {
  const std::vector<InitialPoint>& points;
  const std::vector<std::uint32_t>& members;

  std::size_t kdtree_get_point_count() const { return members.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points[members[i]].position[axis];
  }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

// Computes the root mean square distance of each member to its nearest neighbours among the
// members.
void neighbour_distances(const std::vector<InitialPoint>& points,
                         const std::vector<std::uint32_t>& members, float fallback,
                         std::vector<float>& distances) {
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointView>,
                                                   PointView, 3>;
  const PointView view{points, members};
  const Tree tree(3, view);
  parallel_for(std::size_t{0}, members.size(), [&](std::size_t i) {
    std::uint32_t found[kNeighbours + 1];
    float squares[kNeighbours + 1];
    const std::size_t count =
        tree.knnSearch(points[members[i]].position, kNeighbours + 1, found, squares);
    float sum = 0.0f;
    for (std::size_t k = 0; k < count; ++k) sum += squares[k];  // the point itself adds 0
    const float mean = count > 1 ? sum / static_cast<float>(count - 1) : 0.0f;
    distances[members[i]] = mean > 0.0f ? std::sqrt(mean) : fallback;
  });
}

// Selects a random subset of at most `limit` points, in the original order. The subset of a smaller
// limit is contained in that of a larger one.
void subsample(std::vector<InitialPoint>& points, std::size_t limit, Random random) {
  if (points.size() <= limit) return;
  std::vector<std::uint64_t> keys(points.size());  // distinct, because bits() is a permutation
  for (std::uint64_t& key : keys) key = random.bits();
  std::vector<std::uint64_t> order = keys;
  const auto bound = order.begin() + static_cast<std::ptrdiff_t>(limit);
  std::nth_element(order.begin(), bound, order.end());
  std::vector<InitialPoint> selected;
  selected.reserve(limit);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (keys[i] < *bound) selected.push_back(points[i]);
  }
  points = std::move(selected);
}

// The persistent set of a window after the first, and how its content has changed.
struct Persistent {
  const TrainState& state;
  const SceneChanges& changes;
};

// `persistent`: null before the second window. Otherwise static points are those of its changes.
Result<std::vector<InitialPoint>> load_points(const PreparedCapture& capture,
                                              const HyperParameters& parameters,
                                              const Ablation& ablation, std::uint64_t seed,
                                              const Persistent* persistent) {
  STGS_ASSIGN(InitialPoints read, read_initial_points(capture, persistent == nullptr));
  std::vector<InitialPoint>& static_points = read.statics;
  std::vector<InitialPoint>& dynamic_points = read.dynamics;
  if (persistent != nullptr) static_points = persistent->changes.points;
  if (capture.mask_background) STGS_TRY(keep_foreground(capture, static_points));
  if (!ablation.initialisation) {
    if (!read.is_moving) {
      return usage_error(
          "--ablate: initialisation has no effect, because {} has no dynamic points; remove it",
          capture.folder);
    }
    std::erase_if(dynamic_points, [](const InitialPoint& point) { return point.frame != 0; });
    for (InitialPoint& point : dynamic_points) {
      point.frame = -1;
      std::fill_n(point.velocity, 3, 0.0f);
    }
  }
  // Relocation adds none.
  const double fraction =
      ablation.densification == Densification::kRelocation ? 1.0 : kInitialFraction;
  const std::size_t fixed = persistent == nullptr ? 0 : persistent->state.count_fixed();
  const std::size_t limit = max_trained(parameters, fixed);
  const std::size_t candidates = persistent == nullptr ? 0 : persistent->state.size() - fixed;
  const auto budget = std::max(
      std::size_t{1}, static_cast<std::size_t>(
                          fraction * static_cast<double>(limit - std::min(limit, candidates))));
  const auto dynamic_budget =
      static_cast<std::size_t>(kDynamicFraction * static_cast<double>(budget));
  const std::size_t static_count =
      std::min(static_points.size(), budget - std::min(dynamic_budget, dynamic_points.size()));
  subsample(dynamic_points, budget - static_count, Random(seed, 0, RandomPurpose::kInitial));
  subsample(static_points, static_count, Random(kSharedSeed, 0, RandomPurpose::kStatic));
  static_points.insert(static_points.end(), dynamic_points.begin(), dynamic_points.end());
  if (static_points.empty() && persistent == nullptr) {
    return invalid_file("{}: no initial points; run 'stgs prepare' again and check its report",
                        capture.folder);
  }
  return static_points;
}

float logit(double p) {
  return static_cast<float>(std::log(p / (1.0 - p)));
}

// A point with a normal becomes a disc on its surface, another a sphere.
void set_orientation(const InitialPoint& point, std::size_t i, Gaussians4D& set) {
  float* q = &set.rotation[4 * i];
  const float x = point.normal[0], y = point.normal[1], z = point.normal[2];
  if (x == 0.0f && y == 0.0f && z == 0.0f) {
    q[0] = 1.0f;
    return;
  }
  // The rotation from the z axis to the normal, or to its opposite, which is the same disc.
  const float sign = z < 0.0f ? -1.0f : 1.0f;
  q[0] = 1.0f + sign * z;
  q[1] = -sign * y;
  q[2] = sign * x;
  const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
  for (int k = 0; k < 3; ++k) q[k] /= length;
  set.log_scale[3 * i + 2] += std::log(kFlatness);
}

void set_primitive(const InitialPoint& point, float scale, const PreparedCapture& capture,
                   const HyperParameters& parameters, const Ablation& ablation, std::size_t i,
                   TrainState& state) {
  Gaussians4D& set = state.set;
  const bool dynamic = point.frame >= 0;
  std::copy_n(point.position, 3, set.position.begin() + static_cast<std::ptrdiff_t>(3 * i));
  std::fill_n(set.log_scale.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, std::log(scale));
  set_orientation(point, i, set);
  set.opacity_logit[i] =
      logit(dynamic ? parameters.initial_opacity_dynamic : parameters.initial_opacity);
  for (int c = 0; c < 3; ++c) {
    set.sh[i * state.components(kSh) + c] =
        (static_cast<float>(point.colour[c]) / 255.0f - 0.5f) / math::kSh00;
  }
  const double clip = capture.frames;
  const double sigma = dynamic ? parameters.sigma_dynamic : parameters.sigma_static * clip;
  set.time[i] = dynamic ? static_cast<float>(point.frame) : static_cast<float>(0.5 * (clip - 1.0));
  set.radius[i] = ablation.lifespan ? static_cast<float>(parameters.initial_radius) : 0.0f;
  state.log_sigma[i] = static_cast<float>(std::log(sigma));
  const float f = math::lifespan_modulation(static_cast<float>(sigma), set.radius[i]);
  const float gain = ablation.modulation && parameters.velocity_times_f != 0 ? f : 1.0f;
  for (int c = 0; c < 3; ++c) state.velocity[3 * i + c] = point.velocity[c] * gain;
}

// Makes the primitives of static points visible from a frame on, if it is not the first.
void begin_at(int first, int frames, const std::vector<InitialPoint>& points, TrainState& state) {
  if (first <= 0) return;
  const float half = 0.5f * static_cast<float>(frames - 1 - first);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].frame >= 0) continue;
    state.set.time[i] = static_cast<float>(first) + half;
    state.set.radius[i] = half;
    state.log_sigma[i] = std::log(kBeginSigma);
  }
}

// Returns the initial state without its background.
Result<TrainState> initial_points_state(const PreparedCapture& capture,
                                        const HyperParameters& parameters, const Ablation& ablation,
                                        std::uint64_t seed,
                                        const Persistent* persistent = nullptr) {
  STGS_ASSIGN(const std::vector<InitialPoint> points,
              load_points(capture, parameters, ablation, seed, persistent));
  std::map<int, std::vector<std::uint32_t>> by_frame;
  for (std::size_t i = 0; i < points.size(); ++i) {
    by_frame[points[i].frame].push_back(static_cast<std::uint32_t>(i));
  }
  const auto radius = static_cast<float>(capture.scene_radius);
  const Vicinity vicinity = vicinity_of(capture);
  std::vector<float> distances(points.size());
  std::vector<const std::vector<std::uint32_t>*> frames;
  for (const auto& [frame, members] : by_frame) frames.push_back(&members);
  parallel_for(std::size_t{0}, frames.size(), [&](std::size_t k) {
    neighbour_distances(points, *frames[k], 0.01f * radius, distances);
  });
  TrainState state;
  state.set.sh_degree = parameters.sh_degree;
  state.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double factor =
        points[i].frame >= 0 ? parameters.initial_scale_dynamic : parameters.initial_scale;
    const float* p = points[i].position;
    const float largest = 0.1f * radius * size_factor(vicinity, {p[0], p[1], p[2]});
    const float scale =
        std::clamp(static_cast<float>(factor) * distances[i], 1e-4f * radius, largest);
    set_primitive(points[i], scale, capture, parameters, ablation, i, state);
  }
  const std::size_t training_cameras = capture.training_cameras().size();
  state.colour.assign(training_cameras, kIdentityColour);
  state.colour_first.assign(training_cameras, ColourMap{});
  state.colour_second.assign(training_cameras, ColourMap{});
  state.colour_updates.assign(training_cameras, 0);
  if (persistent != nullptr) begin_at(persistent->changes.settled, capture.frames, points, state);
  state.derive_all(ablation.modulation);
  if (!ablation.representation) {
    // The unit of time is the second, as in 4DGS. In frames, a rotation step would move long-lived
    // primitives too far.
    start_coupled(state, static_cast<float>(capture.time_base.seconds(1)));
    state.derive_all(false);
  }
  return state;
}

// Removes the primitives of sky and far background. Returns whether there are more than a few.
bool remove_far(const Vicinity& vicinity, TrainState& state) {
  std::vector<std::uint32_t> near;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (!is_far(vicinity, &state.set.position[3 * i]))
      near.push_back(static_cast<std::uint32_t>(i));
  }
  const double share = 1.0 - static_cast<double>(near.size()) / static_cast<double>(state.size());
  if (share < kFarShare) return false;
  state.retain(near);
  return true;
}

// Returns the primitives of both states, with the colours and cameras of the first. Neither has
// been trained since they were made.
TrainState joined(const TrainState& first, const TrainState& second) {
  TrainState out = first.without_primitives();
  out.resize(first.size() + second.size());
  for (const TrainState* from : {&first, &second}) {
    const std::size_t to = from == &first ? 0 : first.size();
    parallel_blocks(std::size_t{0}, from->size(), kPrimitivesPerTask / 4,
                    [&](std::size_t begin, std::size_t end) {
                      out.copy_parameters(*from, begin, end, to + begin);
                    });
  }
  std::copy(first.updates.begin(), first.updates.end(), out.updates.begin());
  return out;
}

}  // namespace

Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed,
                                 const PersistentSet* persistent, SceneChanges* changes) {
  if (persistent != nullptr && persistent->state() != nullptr) {
    const TrainState& stored = *persistent->state();
    const Status same = check_state("", stored, capture, parameters.sh_degree,
                                    !ablation.representation, !stored.cameras.empty());
    if (!same.ok()) {
      return invalid_file(
          "{}: the persistent set of the previous window belongs to another run; remove the work "
          "folder and encode again",
          capture.folder);
    }
    const auto most = static_cast<std::size_t>(kChangedPointShare * parameters.max_primitives);
    STGS_ASSIGN(*changes,
                find_changes(capture, stored, persistent->residuals(), parameters.kernel, most));
    const Persistent set{stored, *changes};
    STGS_ASSIGN(const TrainState fresh,
                initial_points_state(capture, parameters, ablation, seed, &set));
    TrainState state = joined(stored, fresh);
    for (const EndedPrimitive& ended : changes->ended) end_at(state.set, ended.index, ended.frame);
    return state;
  }
  STGS_ASSIGN(TrainState state, initial_points_state(capture, parameters, ablation, seed));
  if (parameters.seen_background != 0 && !capture.mask_background) {
    STGS_ASSIGN(TrainState initial,
                initial_points_state(capture, parameters, ablation, kSharedSeed));
    const bool has_far = remove_far(vicinity_of(capture), initial);
    STGS_ASSIGN(state.background,
                scene_background(capture, initial.set, parameters.kernel, has_far));
  }
  return state;
}

}  // namespace stgs::encoder
