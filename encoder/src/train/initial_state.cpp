// SPDX-License-Identifier: Apache-2.0
#include "train/initial_state.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nanoflann.hpp>

#include "stgs/encoder/windows.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"
#include "train/coupled_state.h"
#include "train/random.h"
#include "train/scene_background.h"

namespace stgs::encoder {
namespace {

constexpr double kInitialShare = 0.6;  // of max_primitives; densification adds the rest
constexpr double kDynamicShare = 0.5;  // of the initial primitives, at most, where both are plenty
constexpr int kNeighbours = 3;
// Of what all windows of a capture share, whatever their own seeds are.
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

// Root mean square distance of each member to its nearest neighbours among the members.
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
    for (std::size_t k = 0; k < count; ++k) sum += squares[k];  // its own is 0
    const float mean = count > 1 ? sum / static_cast<float>(count - 1) : 0.0f;
    distances[members[i]] = mean > 0.0f ? std::sqrt(mean) : fallback;
  });
}

// A random subset of at most `limit`, in the original order; that of a smaller limit lies within
// that of a larger one.
void thin(std::vector<InitialPoint>& points, std::size_t limit, Random random) {
  if (points.size() <= limit) return;
  std::vector<std::uint64_t> lots(points.size());  // no two alike, for bits() is a permutation
  for (std::uint64_t& lot : lots) lot = random.bits();
  std::vector<std::uint64_t> order = lots;
  const auto bound = order.begin() + static_cast<std::ptrdiff_t>(limit);
  std::nth_element(order.begin(), bound, order.end());
  std::vector<InitialPoint> kept;
  kept.reserve(limit);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (lots[i] < *bound) kept.push_back(points[i]);
  }
  points = std::move(kept);
}

// Of a file that 'prepare' always writes, be it with no points.
Result<std::vector<InitialPoint>> read_prepared_points(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::status(path, ignored).type() == std::filesystem::file_type::not_found) {
    return io_error(
        "{}: is missing, so the folder is not what 'stgs prepare' made; copy it again, or "
        "prepare the capture again",
        path);
  }
  return read_points(path);
}

Result<std::vector<InitialPoint>> load_points(const PreparedCapture& capture,
                                              const HyperParameters& parameters,
                                              const Ablation& ablation, std::uint64_t seed) {
  const std::string dynamic_path = capture.folder + "/points_dynamic.ply";
  STGS_ASSIGN(std::vector<InitialPoint> fixed,
              read_prepared_points(capture.folder + "/points_static.ply"));
  STGS_ASSIGN(std::vector<InitialPoint> moving, read_prepared_points(dynamic_path));
  if (!ablation.initialisation && moving.empty()) {
    return usage_error(
        "--ablate initialisation has no effect: nothing was found to move in {}; "
        "leave it out",
        capture.folder);
  }
  const int frames =
      capture.window ? static_cast<int>(capture.window->capture_frames) : capture.frames;
  for (InitialPoint& point : moving) {
    if (point.frame < 0 || point.frame >= frames) {
      return invalid_file("{}: a point has frame {}, but the capture has frames 0 to {}",
                          dynamic_path, point.frame, frames - 1);
    }
    point.frame -= capture.frame_offset();
  }
  std::erase_if(moving, [&capture](const InitialPoint& point) {
    return point.frame < 0 || point.frame >= capture.frames;
  });
  if (!ablation.initialisation) {
    std::erase_if(moving, [](const InitialPoint& point) { return point.frame != 0; });
    for (InitialPoint& point : moving) {
      point.frame = -1;
      std::fill_n(point.velocity, 3, 0.0f);
    }
  }
  const auto budget =
      std::max(std::size_t{1}, static_cast<std::size_t>(kInitialShare * parameters.max_primitives));
  const auto dynamic_budget = static_cast<std::size_t>(kDynamicShare * static_cast<double>(budget));
  const std::size_t static_kept =
      std::min(fixed.size(), budget - std::min(dynamic_budget, moving.size()));
  thin(moving, budget - static_kept, Random(seed, 0, RandomPurpose::kInitial));
  thin(fixed, static_kept, Random(kSharedSeed, 0, RandomPurpose::kStatic));
  fixed.insert(fixed.end(), moving.begin(), moving.end());
  if (fixed.empty()) {
    return invalid_file(
        "{}: has no initial points; prepare the capture again and look at its report",
        capture.folder);
  }
  return fixed;
}

float logit(double p) {
  return static_cast<float>(std::log(p / (1.0 - p)));
}

void set_primitive(const InitialPoint& point, float scale, const PreparedCapture& capture,
                   const HyperParameters& parameters, const Ablation& ablation, std::size_t i,
                   TrainState& state) {
  Gaussians4D& set = state.set;
  const bool dynamic = point.frame >= 0;
  std::copy_n(point.position, 3, set.position.begin() + static_cast<std::ptrdiff_t>(3 * i));
  std::fill_n(set.log_scale.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, std::log(scale));
  set.rotation[4 * i] = 1.0f;
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

// But for the background.
Result<TrainState> start_of(const PreparedCapture& capture, const HyperParameters& parameters,
                            const Ablation& ablation, std::uint64_t seed) {
  STGS_ASSIGN(const std::vector<InitialPoint> points,
              load_points(capture, parameters, ablation, seed));
  std::map<int, std::vector<std::uint32_t>> by_frame;
  for (std::size_t i = 0; i < points.size(); ++i) {
    by_frame[points[i].frame].push_back(static_cast<std::uint32_t>(i));
  }
  const auto radius = static_cast<float>(capture.scene_radius);
  std::vector<float> distances(points.size());
  for (const auto& [frame, members] : by_frame) {
    neighbour_distances(points, members, 0.01f * radius, distances);
  }
  TrainState state;
  state.set.sh_degree = parameters.sh_degree;
  state.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float scale = std::clamp(static_cast<float>(parameters.initial_scale) * distances[i],
                                   1e-4f * radius, 0.1f * radius);
    set_primitive(points[i], scale, capture, parameters, ablation, i, state);
  }
  std::size_t training_cameras = 0;
  for (const Camera& camera : capture.cameras) training_cameras += camera.test ? 0 : 1;
  state.colour.assign(training_cameras, kIdentityColour);
  state.colour_first.assign(training_cameras, ColourMap{});
  state.colour_second.assign(training_cameras, ColourMap{});
  state.colour_updates.assign(training_cameras, 0);
  state.derive_all(ablation.modulation);
  if (!ablation.representation) {
    // Seconds, as in 4DGS: in frames, a step of the rotations would move far what lives long.
    start_coupled(state, static_cast<float>(capture.time_base.seconds(1)));
    state.derive_all(false);
  }
  return state;
}

}  // namespace

Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed) {
  STGS_ASSIGN(TrainState state, start_of(capture, parameters, ablation, seed));
  if (parameters.seen_background != 0) {
    // Of the whole capture and no window's seed, so that all windows have the same.
    const PreparedCapture whole = whole_of(capture);
    STGS_ASSIGN(const TrainState start, start_of(whole, parameters, ablation, kSharedSeed));
    STGS_ASSIGN(state.background, scene_background(whole, start.set));
  }
  return state;
}

}  // namespace stgs::encoder
