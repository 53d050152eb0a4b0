// SPDX-License-Identifier: Apache-2.0
#include "init/init.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>

#include "init/bounds.h"
#include "init/calibration_check.h"
#include "init/colmap_points.h"
#include "init/dynamic_points.h"
#include "init/motion.h"
#include "init/report.h"
#include "init/static_points.h"
#include "init/timing_check.h"
#include "init/velocity.h"
#include "init/work.h"
#include "plural.h"

namespace stgs::encoder {
namespace {

using namespace init;

constexpr int kMotionMaxSide = 640;  // longer side of the images in motion detection, pixels
constexpr int kColmapViews = 12;     // more views add little, and time grows with their square
constexpr int kColmapSeconds = 120;  // limit per step of COLMAP
constexpr int kMeasuredFrames = 6;   // frames that compare the two velocity estimates

// Data passed between the stages.
struct State {
  PreparedCapture& capture;
  const InitSettings& settings;
  Work work;
  std::vector<View> views{};
  CalibrationCheck calibration{};
  std::vector<ViewMotion> motion{};
  std::vector<LateCamera> late{};
  std::vector<bool> masked{};  // whether the masks of a view were given
  StaticScene scene{};
  std::vector<DynamicFrame> frames{};
  std::vector<Velocities> velocities{};
  std::string velocity_kind = "none";
  std::vector<InitialPoint> static_points{}, dynamic_points{};
  std::vector<Finding> findings{};
  std::size_t too_near = 0;            // points removed in front of the near plane
  std::atomic<bool> abandoned{false};  // the features are no longer needed
  // Declared last, so that its destructor joins the thread before the other members are destroyed.
  std::future<Result<std::vector<SurfacePoint>>> features{};
};

int static_limit(const State& state) {
  if (state.settings.max_static_points > 0) return state.settings.max_static_points;
  const Camera& camera = *state.views[0].camera;
  return std::clamp(camera.width * camera.height / 6, 15000, 60000);
}

int dynamic_limit(const State& state) {
  if (state.settings.max_dynamic_points > 0) return state.settings.max_dynamic_points;
  const Camera& camera = *state.views[0].camera;
  return std::clamp(camera.width * camera.height / 100, 1000, 5000);
}

Status check_calibration(State& state) {
  const Status status = check_cameras(state.capture, state.views, state.settings.name, state.work,
                                      &state.calibration);
  if (status.code() != StatusCode::kInvalidFile || !state.settings.trust_calibration) return status;
  state.work.log("calibration: " + status.message(), 1);
  return {};
}

Status find_all_motion(State& state) {
  state.work.stage("motion");
  state.motion.resize(state.views.size());
  if (!state.settings.separate_motion) {
    return state.work.for_each(int(state.views.size()), [&](int i) -> Status {
      STGS_ASSIGN(state.motion[i].background, load_image(state.capture, state.views[i], 0));
      state.motion[i].background_valid = cv::Mat(state.views[i].size(), CV_8U, cv::Scalar(255));
      return {};
    });
  }
  STGS_TRY(state.work.for_each(int(state.views.size()), [&](int i) {
    return find_motion(state.capture, state.views[i], state.settings, state.work, &state.motion[i]);
  }));
  double share = 0;
  for (const ViewMotion& motion : state.motion) {
    for (const float c : motion.coverage) share += c / float(motion.coverage.size());
    state.masked.push_back(motion.given_masks);
  }
  state.work.log(fmt::format("motion: {:.1f} % of the pixels are dynamic; masks given for {} of {}",
                             100 * share / double(state.views.size()),
                             std::count(state.masked.begin(), state.masked.end(), true),
                             plural(state.masked.size(), "camera")));
  return {};
}

Status find_static(State& state) {
  std::vector<std::vector<StaticImage>> backgrounds(1);
  for (std::size_t i = 0; i < state.views.size(); ++i) {
    backgrounds[0].push_back(
        {state.views[i], state.motion[i].background, state.motion[i].background_valid});
  }
  // Dynamic content may be nearer than the background, so the range also uses the full frame 0.
  std::vector<std::vector<StaticImage>> with_frames = backgrounds;
  if (state.settings.separate_motion) {
    with_frames.emplace_back();
    for (const View& view : state.views) {
      STGS_ASSIGN(const cv::Mat image, load_image(state.capture, view, 0));
      with_frames.back().push_back({view, image, {}});
    }
  }
  state.work.stage("depth range", int(with_frames.size()));
  STGS_TRY(find_depth_range(with_frames, state.work, &state.scene));
  if (!state.scene.range.measured) {
    state.work.log("depth range: not measurable from the images; estimated from the cameras", 1);
  }
  state.work.log(fmt::format("depth range: {:.3g} to {:.3g}", state.scene.range.nearest,
                             state.scene.range.farthest));
  state.work.stage("static depth", 2);
  STGS_TRY(find_static_depth(backgrounds[0], state.work, &state.scene));
  return refine_static_depth(backgrounds[0], state.settings.backend, state.work, &state.scene);
}

// Returns the points that came with the capture, except those on dynamic content in frame 0.
Result<std::vector<SurfacePoint>> given_points(State& state) {
  std::vector<SurfacePoint> points;
  std::vector<cv::Mat> masks(state.views.size());
  for (std::size_t i = 0; state.settings.separate_motion && i < state.views.size(); ++i) {
    STGS_ASSIGN(masks[i], load_mask_image(state.capture, state.views[i], 0));
  }
  for (const InitialPoint& point : state.settings.points) {
    const cv::Vec3d position(point.position[0], point.position[1], point.position[2]);
    int visible = 0, dynamic = 0;
    for (std::size_t i = 0; i < state.views.size(); ++i) {
      const Pixel p = project(state.views[i], position);
      if (!p.inside) continue;
      ++visible;
      dynamic += !masks[i].empty() && masks[i].at<std::uint8_t>(p.y(), p.x()) ? 1 : 0;
    }
    if (visible == 0 || 2 * dynamic > visible) continue;
    points.push_back({position, {point.colour[0], point.colour[1], point.colour[2]}});
  }
  return points;
}

// Starts the triangulation of the features of frame 0 in parallel with the following stages. COLMAP
// is optional: without it the initial points are only less accurate.
void start_features(State& state) {
  if (!state.settings.use_colmap || state.views.size() < 2) return;
  if (!colmap_installed()) {
    state.work.log("features: skipped (COLMAP is not installed)", 1);
    return;
  }
  state.features = std::async(std::launch::async, [&state] {
    Result<std::vector<SurfacePoint>> points{std::vector<SurfacePoint>{}};
    const Status status = guarded("colmap", [&]() -> Status {
      STGS_ASSIGN(points, colmap_points(state.capture, kColmapViews, state.settings.separate_motion,
                                        kColmapSeconds, state.abandoned));
      return {};
    });
    return status.ok() ? points : Result<std::vector<SurfacePoint>>{status};
  });
}

Result<std::vector<SurfacePoint>> feature_points(State& state) {
  std::vector<SurfacePoint> points;
  if (!state.features.valid()) return points;
  state.work.stage("features");
  const auto ready = [&]() -> Status {
    while (state.features.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready) {
      STGS_TRY(state.work.check());
    }
    return {};
  };
  STGS_TRY(state.work.wait_for(ready));
  const auto found = state.features.get();
  if (!found.ok()) {
    state.work.log(fmt::format("features: none ({})", found.status().message()), 1);
    return points;
  }
  // A point outside the measured depth range in every view is a mismatch.
  for (const SurfacePoint& point : *found) {
    const bool plausible =
        std::any_of(state.views.begin(), state.views.end(), [&](const View& view) {
          const Pixel p = project(view, point.position);
          return p.inside && p.depth > state.scene.range.nearest &&
                 p.depth < state.scene.range.farthest;
        });
    if (plausible) points.push_back(point);
  }
  state.work.log(found->empty()
                     ? fmt::format("features: none (COLMAP found no matches between {} views)",
                                   std::min(kColmapViews, int(state.views.size())))
                     : fmt::format("features: {} points triangulated by COLMAP", points.size()));
  return points;
}

Status choose_static(State& state) {
  STGS_ASSIGN(std::vector<SurfacePoint> sparse, feature_points(state));
  state.work.stage("static points");
  STGS_ASSIGN(const std::vector<SurfacePoint> given, given_points(state));
  sparse.insert(sparse.end(), given.begin(), given.end());
  choose_static_points(sparse, static_limit(state), &state.scene);
  state.work.log(fmt::format(
      "static points: {} ({} given or from features, {} from depth, {} interpolated)",
      state.scene.points.size(), state.scene.sparse, state.scene.swept, state.scene.filled));
  return {};
}

Status find_dynamic(State& state) {
  state.work.stage("dynamic points");
  DynamicSettings settings;
  settings.limit = dynamic_limit(state);
  state.frames.resize(state.capture.frames);
  STGS_TRY(state.work.for_each(state.capture.frames, [&](int frame) {
    return find_dynamic_points(state.capture, state.views, state.scene, frame, settings, state.work,
                               &state.frames[frame]);
  }));
  std::size_t points = 0, checked = 0;
  for (const DynamicFrame& frame : state.frames) {
    points += frame.points.size();
    checked += frame.checked;
  }
  state.work.log(fmt::format("dynamic points: {} in {} ({} confirmed by another view)", points,
                             plural(state.frames.size(), "frame"), checked));
  return {};
}

// Computes both velocity estimates of a frame. The last frame uses the frame before it.
void velocities_of(const State& state, int frame, Velocities* matched, Velocities* flowed) {
  const int last = state.capture.frames - 1;
  const std::vector<SurfacePoint>& points = state.frames[frame].points;
  // Upper bound of a plausible velocity, scene units per frame: 1/15 of the image width at the
  // focus.
  const double reach = state.scene.focus.depth * state.views[0].width / state.views[0].fx / 15;
  if (last == 0 || points.empty()) {
    matched->assign(points.size(), cv::Vec3d(0, 0, 0));
    *flowed = *matched;
    return;
  }
  const int other = frame < last ? frame + 1 : frame - 1;
  *matched = match_velocities(points, state.frames[other].points, reach, frame < last ? 1 : -1);
  if (frame < last) {
    *flowed = flow_velocities(points, state.views, state.motion, frame, reach);
    *flowed = fill_unknown(*flowed, *matched);
  }
  *matched = fill_unknown(*matched, *matched);
}

Status find_velocities(State& state) {
  const int frames = state.capture.frames;
  state.work.stage("velocities", frames > 1 ? 2 : 1);
  std::vector<Velocities> matched(frames), flowed(frames);
  STGS_TRY(state.work.for_each(frames, [&](int frame) -> Status {
    velocities_of(state, frame, &matched[frame], &flowed[frame]);
    return {};
  }));
  if (frames > 1) {
    flowed[frames - 1] = propagate_velocities(state.frames[frames - 1], state.frames[frames - 2],
                                              flowed[frames - 2]);
  }
  struct Measured {
    MotionFit zero, matched, flowed;
  };
  const int count = std::min(frames - 1, kMeasuredFrames);
  std::vector<Measured> measured(std::max(0, count));
  STGS_TRY(state.work.for_each(count, [&](int i) -> Status {
    const int frame = count == 1 ? 0 : i * (frames - 2) / (count - 1);
    const std::vector<SurfacePoint>& points = state.frames[frame].points;
    const Velocities zero(points.size(), cv::Vec3d(0, 0, 0));
    const auto fit = [&](const Velocities& v) {
      return measure_motion(state.capture, state.views, points, v, frame + 1);
    };
    STGS_ASSIGN(measured[i].zero, fit(zero));
    STGS_ASSIGN(measured[i].matched, fit(matched[frame]));
    STGS_ASSIGN(measured[i].flowed, fit(flowed[frame]));
    return {};
  }));
  double by_zero = 0, by_match = 0, by_flow = 0;
  long samples = 0;
  for (const Measured& m : measured) {
    if (m.zero.samples == 0) continue;
    samples += m.zero.samples;
    by_zero += m.zero.residual() / count;
    by_match += m.matched.residual() / count;
    by_flow += m.flowed.residual() / count;
  }
  const bool flow_wins = by_flow < by_match;
  state.velocities = flow_wins ? flowed : matched;
  if (samples == 0) {
    state.work.log("velocities: not measured (no dynamic points in the sampled frames)");
    return {};
  }
  state.velocity_kind = flow_wins ? "lifted flow" : "nearest neighbours";
  state.work.log(
      fmt::format("velocities: {} (residual in the next frame: zero velocity {:.2f}, nearest "
                  "neighbours {:.2f}, lifted flow {:.2f})",
                  state.velocity_kind, by_zero, by_match, by_flow));
  return {};
}

void collect_points(State& state) {
  const cv::Vec3d zero(0, 0, 0);
  for (const SurfacePoint& point : state.scene.points) {
    state.static_points.push_back(initial_point(point, zero, -1));
  }
  for (std::size_t f = 0; f < state.frames.size(); ++f) {
    for (std::size_t i = 0; i < state.frames[f].points.size(); ++i) {
      state.dynamic_points.push_back(
          initial_point(state.frames[f].points[i], state.velocities[f][i], int(f)));
    }
  }
  std::vector<InitialPoint> all = state.static_points;
  all.insert(all.end(), state.dynamic_points.begin(), state.dynamic_points.end());
  set_bounds(state.views, all, state.scene.far, &state.capture);
  drop_too_near(state.views, state.capture.near_plane, &state.static_points);
  drop_too_near(state.views, state.capture.near_plane, &state.dynamic_points);
  state.too_near = all.size() - state.static_points.size() - state.dynamic_points.size();
  const double* c = state.capture.scene_centre;
  state.work.log(
      fmt::format("scene: centre ({:.3g}, {:.3g}, {:.3g}), radius {:.3g}, near plane "
                  "{:.3g} (removed {} in front of it)",
                  c[0], c[1], c[2], state.capture.scene_radius, state.capture.near_plane,
                  plural(state.too_near, "point")));
}

ReportFacts facts_of(const State& state) {
  ReportFacts facts;
  const auto add = [&](const char* name, const std::string& value) {
    facts.lines.emplace_back(name, value);
  };
  add("static points",
      fmt::format("{} (found: {} given or from features, {} from depth, {} interpolated)",
                  state.static_points.size(), state.scene.sparse, state.scene.swept,
                  state.scene.filled));
  add("dynamic points", fmt::format("{}, {:.0f} per frame", state.dynamic_points.size(),
                                    double(state.dynamic_points.size()) / state.capture.frames));
  add("removed points", fmt::format("{}, in front of the near plane", state.too_near));
  add("velocities from", state.velocity_kind);
  add("calibration", text_of(state.calibration, state.views));
  add("depth range",
      fmt::format("{:.3g} to {:.3g}{}", state.scene.range.nearest, state.scene.range.farthest,
                  state.scene.range.measured ? "" : " (estimated)"));
  if (state.scene.far > 0) add("far background", fmt::format("at {:.3g}", state.scene.far));
  add("near plane", fmt::format("{:.3g}", state.capture.near_plane));
  add("scene radius", fmt::format("{:.3g}", state.capture.scene_radius));
  facts.seconds = state.work.timings();
  facts.findings = state.findings;
  return facts;
}

Status run(State& state) {
  state.views = training_views(state.capture, kMotionMaxSide);
  if (state.views.empty()) {
    return usage_error("{}: every camera is held out; leave some for training (--test-cameras)",
                       state.settings.name);
  }
  STGS_TRY(check_calibration(state));
  STGS_TRY(find_all_motion(state));
  if (state.settings.separate_motion)
    STGS_TRY(check_timing(state.capture, state.views, state.calibration, state.work, &state.late));
  start_features(state);
  STGS_TRY(find_static(state));
  if (state.settings.separate_motion) {
    STGS_TRY(find_dynamic(state));
    STGS_TRY(find_velocities(state));
  }
  STGS_TRY(choose_static(state));
  collect_points(state);
  state.findings = find_weaknesses(state.views, state.scene, state.calibration, state.late,
                                   state.masked, state.scene.points);
  for (const Finding& f : state.findings)
    if (!f.is_logged) state.work.log(fmt::format("{}; {}", f.text, f.remedy), 1);
  const std::string& folder = state.capture.folder;
  STGS_TRY(write_points(folder + "/points_static.ply", state.static_points));
  STGS_TRY(write_points(folder + "/points_dynamic.ply", state.dynamic_points));
  if (state.settings.write_report) {
    state.work.stage("report");
    STGS_TRY(write_report(state.capture, state.views, state.scene, state.motion,
                          state.static_points, state.dynamic_points, facts_of(state)));
  }
  for (const auto& [stage, seconds] : state.work.timings()) {
    state.work.log(fmt::format("{}: {:.1f} s", stage, seconds), 3);
  }
  return {};
}

}  // namespace

Status initialise(PreparedCapture& capture, const InitSettings& settings,
                  const ProgressSink& progress, const LogSink& log) {
  State state{capture, settings, Work(progress, log)};
  Status status = guarded("initialisation", [&] { return run(state); });
  state.abandoned = true;
  return status;
}

}  // namespace stgs::encoder
