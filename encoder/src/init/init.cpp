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

constexpr int kMotionMaxSide = 640;      // longer side of the images in motion detection, pixels
constexpr int kColmapViews = 12;         // more views add little, and time grows with their square
constexpr int kColmapSeconds = 120;      // limit per step of COLMAP
constexpr std::size_t kMinAgreeing = 3;  // with fewer views there is no stereo

// Data passed between the stages.
struct State {
  PreparedCapture& capture;
  const InitSettings& settings;
  Work work;
  std::vector<View> views{};
  CalibrationCheck calibration{};
  std::vector<ViewMotion> motion{};
  // Those whose calibration agrees with the others, or all if few do. Points come from them alone:
  // a wrong pose puts points in wrong places, also by its masks and as the partner of other views.
  std::vector<View> agreeing{};
  std::vector<ViewMotion> agreeing_motion{};
  std::vector<LateCamera> late{};
  std::vector<bool> masked{};  // whether the masks of a view were given
  StaticScene scene{};
  std::vector<DynamicFrame> frames{};
  ChosenVelocities velocities{};
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

void select_agreeing(State& state) {
  std::string outliers;
  const bool keep_all = state.settings.trust_calibration ||
                        state.views.size() < kMinAgreeing + state.calibration.outliers.size();
  for (std::size_t i = 0; i < state.views.size(); ++i) {
    if (state.calibration.is_outlier(int(i))) {
      outliers += fmt::format("{}'{}'", outliers.empty() ? "" : ", ", state.views[i].camera->name);
      if (!keep_all) continue;
    }
    state.agreeing.push_back(state.views[i]);
    state.agreeing_motion.push_back(state.motion[i]);
  }
  if (!outliers.empty())
    state.work.log(fmt::format("points: {} {}, whose calibration disagrees",
                               keep_all ? "also from" : "not from", outliers));
}

Status find_static(State& state) {
  std::vector<std::vector<StaticImage>> backgrounds(1);
  for (std::size_t i = 0; i < state.agreeing.size(); ++i) {
    const ViewMotion& motion = state.agreeing_motion[i];
    backgrounds[0].push_back({state.agreeing[i], motion.background, motion.background_valid});
  }
  // Dynamic content may be nearer than the background, so the range also uses the full frame 0.
  std::vector<std::vector<StaticImage>> with_frames = backgrounds;
  if (state.settings.separate_motion) {
    with_frames.emplace_back();
    for (const View& view : state.agreeing) {
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
  std::vector<cv::Mat> masks(state.agreeing.size());
  for (std::size_t i = 0; state.settings.separate_motion && i < state.agreeing.size(); ++i) {
    STGS_ASSIGN(masks[i], load_mask_image(state.capture, state.agreeing[i], 0));
  }
  for (const InitialPoint& point : state.settings.points) {
    const cv::Vec3d position(point.position[0], point.position[1], point.position[2]);
    int visible = 0, dynamic = 0;
    for (std::size_t i = 0; i < state.agreeing.size(); ++i) {
      const Pixel p = project(state.agreeing[i], position);
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
  if (!state.settings.use_colmap || state.agreeing.size() < 2) return;
  if (!colmap_installed()) {
    state.work.log("features: skipped (COLMAP is not installed)", 1);
    return;
  }
  state.features = std::async(std::launch::async, [&state] {
    Result<std::vector<SurfacePoint>> points{std::vector<SurfacePoint>{}};
    const Status status = guarded("colmap", [&]() -> Status {
      STGS_ASSIGN(points,
                  colmap_points(state.capture, state.agreeing, kColmapViews,
                                state.settings.separate_motion, kColmapSeconds, state.abandoned));
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
        std::any_of(state.agreeing.begin(), state.agreeing.end(), [&](const View& view) {
          const Pixel p = project(view, point.position);
          return p.inside && p.depth > state.scene.range.nearest &&
                 p.depth < state.scene.range.farthest;
        });
    if (plausible) points.push_back(point);
  }
  state.work.log(found->empty()
                     ? fmt::format("features: none (COLMAP found no matches between {} views)",
                                   std::min(kColmapViews, int(state.agreeing.size())))
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
  const DynamicFinder finder(state.capture, state.agreeing, state.scene, settings);
  STGS_TRY(state.work.for_each(state.capture.frames, [&](int frame) {
    return finder.find(frame, state.work, &state.frames[frame]);
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

Status find_velocities(State& state) {
  VelocityInput input{state.capture, state.agreeing, state.agreeing_motion, state.frames, 0, {}};
  // Upper bound of a plausible velocity: 1/15 of the image width at the focus.
  input.reach = state.scene.focus.depth * state.agreeing[0].width / state.agreeing[0].fx / 15;
  input.find_flow = [&state](const std::vector<int>& frames) {
    return state.work.for_each(int(frames.size() * state.agreeing.size()), [&](int i) {
      const std::size_t view = std::size_t(i) / frames.size();
      return find_frame_flow(state.capture, state.agreeing[view], state.settings,
                             frames[std::size_t(i) % frames.size()], &state.agreeing_motion[view]);
    });
  };
  return choose_velocities(input, state.work, &state.velocities);
}

void collect_points(State& state) {
  const cv::Vec3d zero(0, 0, 0);
  for (const SurfacePoint& point : state.scene.points) {
    state.static_points.push_back(initial_point(point, zero, -1));
  }
  for (std::size_t f = 0; f < state.frames.size(); ++f) {
    for (std::size_t i = 0; i < state.frames[f].points.size(); ++i) {
      state.dynamic_points.push_back(
          initial_point(state.frames[f].points[i], state.velocities.frames[f][i], int(f)));
    }
  }
  std::vector<InitialPoint> all = state.static_points;
  all.insert(all.end(), state.dynamic_points.begin(), state.dynamic_points.end());
  set_bounds(state.agreeing, all, state.scene.far, &state.capture);
  drop_too_near(state.agreeing, state.capture.near_plane, &state.static_points);
  drop_too_near(state.agreeing, state.capture.near_plane, &state.dynamic_points);
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
  add("velocities from", state.velocities.kind);
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
  select_agreeing(state);
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
