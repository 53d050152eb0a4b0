// SPDX-License-Identifier: Apache-2.0
#include "init/init.h"

#include <algorithm>
#include <cmath>

#include "geometry/velocity_matcher.h"
#include "geometry/view_matcher.h"
#include "init/bounds.h"
#include "init/calibration_check.h"
#include "init/dynamic_points.h"
#include "init/motion.h"
#include "init/point_frames.h"
#include "init/report.h"
#include "init/static_findings.h"
#include "init/timing_check.h"
#include "init/velocity.h"
#include "init/work.h"
#include "plural.h"
#include "stgs/encoder/frame_memory.h"

namespace stgs::encoder {

namespace {

using namespace init;

// Longer side of the images in motion detection, pixels. When live, it is that of the masks which
// dynamic points need (dynamic_points.h).
constexpr int kMaxSide = 640, kLiveMaxSide = 320;
// The same in the check of the calibration; features of larger images do not match better.
constexpr int kFeatureSide = 448;
constexpr std::size_t kMinAgreeing = 3;  // with fewer views there is no stereo

// Data passed between the stages.
struct State {
  PreparedCapture& capture;
  const InitSettings& settings;
  Work work;
  std::vector<View> views{};
  CalibrationCheck calibration{};
  std::shared_ptr<geometry::MotionFinder> motion_finder = settings.motion_finder;
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
  std::size_t too_near = 0;  // points removed in front of the near plane
  bool with_statics = true;  // false: a later window
  TimingCheck timing{};      // last, because its threads use the members above
};

LogSink log_of(const State& state) {
  return [&state](int level, const std::string& line) { state.work.log(line, level); };
}

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

// The training views in the size in which motion is detected.
std::vector<View> motion_views(const State& state) {
  return training_views(state.capture, state.settings.live ? kLiveMaxSide : kMaxSide);
}

Status check_calibration(State& state) {
  const std::vector<View> views = training_views(state.capture, kFeatureSide);
  const Status status =
      check_cameras(state.capture, views, state.settings.name, state.work, &state.calibration);
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
  if (!state.settings.live) {
    STGS_ASSIGN(
        state.motion_finder,
        geometry::make_motion_finder(state.settings.backend, state.settings.gpu, log_of(state)));
  }
  STGS_TRY(state.work.for_each(int(state.views.size()), [&](int i) {
    if (state.settings.live) {
      return find_live_motion(state.capture, state.views[i], state.settings,
                              state.motion_finder.get(), state.work, &state.motion[i]);
    }
    return find_motion(state.capture, state.views[i], state.settings, state.motion_finder.get(),
                       state.work, &state.motion[i]);
  }));
  double share = 0;
  for (const ViewMotion& motion : state.motion) {
    for (const float c : motion.coverage) share += c / float(motion.coverage.size());
    state.masked.push_back(motion.given_masks);
  }
  state.work.log(fmt::format(
      "motion: {:.1f} % of the pixels are dynamic; masks given for {} of {}, backend {}",
      100 * share / double(state.views.size()),
      std::count(state.masked.begin(), state.masked.end(), true),
      plural(state.masked.size(), "camera"),
      state.motion_finder ? state.motion_finder->name() : "cpu"));
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
  STGS_ASSIGN(const auto sweeper, geometry::make_view_sweeper(state.settings.backend,
                                                              state.settings.gpu, log_of(state)));
  STGS_TRY(find_depth_range(with_frames, sweeper.get(), state.work, &state.scene));
  if (!state.scene.range.measured) {
    state.work.log("depth range: not measurable from the images; estimated from the cameras", 1);
  }
  state.work.log(fmt::format("depth range: {:.3g} to {:.3g}, backend {}", state.scene.range.nearest,
                             state.scene.range.farthest, sweeper ? sweeper->name() : "cpu"));
  state.work.stage("static depth", 2);
  STGS_TRY(find_static_depth(backgrounds[0], sweeper.get(), state.work, &state.scene));
  // Started here, because stereo on a GPU leaves the CPU idle.
  if (state.settings.separate_motion && !state.settings.live)
    state.timing.start(state.capture, state.views, state.calibration);
  const StereoChoice choice{state.settings.backend, state.settings.gpu, state.settings.seed};
  return refine_static_depth(backgrounds[0], choice, state.work, &state.scene);
}

Status choose_static(State& state) {
  state.work.stage("static points");
  const std::vector<InitialPoint>& points = state.settings.points;
  STGS_ASSIGN(const std::vector<SurfacePoint> given,
              given_points(state.capture, state.agreeing, points, state.settings.separate_motion));
  choose_static_points(given, static_limit(state), &state.scene);
  state.work.log(fmt::format("static points: {} ({} given, {} from depth, {} interpolated)",
                             state.scene.points.size(), state.scene.given, state.scene.swept,
                             state.scene.filled));
  return {};
}

Status find_dynamic(State& state) {
  state.work.stage("dynamic points");
  DynamicSettings settings;
  settings.limit = dynamic_limit(state);
  state.frames.resize(state.capture.frames);
  std::shared_ptr<geometry::HullSweeper> sweeper = state.settings.sweeper;
  if (!state.settings.live) {
    STGS_ASSIGN(sweeper, geometry::make_hull_sweeper(state.settings.backend, state.settings.gpu,
                                                     log_of(state)));
  }
  settings.max_side = sweeper ? kGpuSweepSide : kCpuSweepSide;
  const DynamicFinder finder(state.capture, state.agreeing, state.scene, settings, sweeper.get());
  const std::vector<int> chosen = point_frames(state.capture.frames, state.settings.point_interval);
  STGS_TRY(state.work.for_each(int(chosen.size()), [&](int i) {
    return finder.find(chosen[i], state.work, &state.frames[chosen[i]]);
  }));
  std::size_t points = 0, checked = 0;
  for (const DynamicFrame& frame : state.frames) {
    points += frame.points.size();
    checked += frame.checked;
  }
  state.work.log(fmt::format("dynamic points: {} in {} ({} confirmed by another view)", points,
                             plural(chosen.size(), "frame"), checked));
  return {};
}

Status find_velocities(State& state) {
  VelocityInput input{state.capture, state.agreeing, state.agreeing_motion, state.frames};
  std::shared_ptr<geometry::VelocityMatcher> gpu = state.settings.velocity_matcher;
  if (!state.settings.live) {
    STGS_ASSIGN(gpu, geometry::make_velocity_matcher(state.settings.backend, state.settings.gpu,
                                                     log_of(state)));
  }
  input.gpu = gpu.get();
  // Upper bound of a plausible velocity: 1/15 of the image width at the focus.
  input.reach = state.scene.focus.depth * state.agreeing[0].width / state.agreeing[0].fx / 15;
  if (state.settings.live) {
    input.interval = std::clamp(state.settings.point_interval, 1, state.capture.frames);
    return choose_velocities(input, state.work, &state.velocities);
  }
  input.find_flow = [&state](const std::vector<int>& frames) {
    return state.work.for_each(int(frames.size() * state.agreeing.size()), [&](int i) {
      const std::size_t view = std::size_t(i) / frames.size();
      return find_frame_flow(state.capture, state.agreeing[view], state.settings,
                             state.motion_finder.get(), frames[std::size_t(i) % frames.size()],
                             &state.agreeing_motion[view]);
    });
  };
  return choose_velocities(input, state.work, &state.velocities);
}

void collect_points(State& state) {
  const cv::Vec3d zero(0, 0, 0);
  if (state.with_statics) {
    for (const SurfacePoint& point : state.scene.points)
      state.static_points.push_back(initial_point(point, zero, -1));
  }
  for (std::size_t f = 0; f < state.frames.size(); ++f) {
    for (std::size_t i = 0; i < state.frames[f].points.size(); ++i) {
      state.dynamic_points.push_back(
          initial_point(state.frames[f].points[i], state.velocities.frames[f][i], int(f)));
    }
  }
  if (!state.with_statics) {
    drop_too_near(state.agreeing, state.capture.near_plane, &state.dynamic_points);
    return;
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
  add("static points", fmt::format("{} (found: {} given, {} from depth, {} interpolated)",
                                   state.static_points.size(), state.scene.given, state.scene.swept,
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
  facts.stages = state.work.timings();
  facts.findings = state.findings;
  return facts;
}

Status hand_over_points(const State& state) {
  const std::string& folder = state.capture.folder;
  if (state.capture.memory)
    state.capture.memory->set_points({state.static_points, state.dynamic_points});
  if (state.capture.memory_only) return {};
  STGS_TRY(write_points(folder + "/points_static.ply", state.static_points));
  return write_points(folder + "/points_dynamic.ply", state.dynamic_points);
}

Status run(State& state) {
  const std::future<void> gpu = geometry::start_gpu(state.settings.backend, state.settings.gpu);
  state.views = motion_views(state);
  if (state.views.empty()) {
    return usage_error("{}: every camera is held out; leave some for training (--test-cameras)",
                       state.settings.name);
  }
  STGS_TRY(check_calibration(state));
  STGS_TRY(find_all_motion(state));
  select_agreeing(state);
  STGS_TRY(find_static(state));
  if (state.settings.separate_motion) {
    STGS_TRY(find_dynamic(state));
    STGS_TRY(find_velocities(state));
  }
  STGS_TRY(choose_static(state));
  STGS_TRY(state.timing.wait(state.work, &state.late));
  collect_points(state);
  state.findings = find_weaknesses(state.views, state.scene, state.calibration, state.late,
                                   state.masked, state.scene.points);
  for (const Finding& f : state.findings)
    if (!f.is_logged) state.work.log(fmt::format("{}; {}", f.text, f.remedy), 1);
  STGS_TRY(hand_over_points(state));
  if (state.settings.write_report) {
    state.work.stage("report");
    STGS_TRY(write_report({state.capture, state.views, state.scene, state.motion,
                           state.static_points, state.dynamic_points},
                          facts_of(state), state.work));
  }
  log_times(state.work.timings(), log_of(state));
  return {};
}

void set_bounds_from(const PreparedCapture& from, PreparedCapture& to) {
  to.near_plane = from.near_plane;
  to.extent = from.extent;
  to.scene_radius = from.scene_radius;
  std::copy_n(from.scene_centre, 3, to.scene_centre);
}

std::shared_ptr<const StaticFindings> findings_of(const State& state) {
  auto out = std::make_shared<StaticFindings>();
  for (const View& view : state.agreeing) out->agreeing.push_back(view.camera->name);
  out->range = state.scene.range;
  out->focus = state.scene.focus;
  for (const Surface& surface : state.scene.surfaces)
    out->surfaces.push_back({{}, {}, surface.depth, surface.weight});
  set_bounds_from(state.capture, out->bounds);
  out->points = state.static_points;
  return out;
}

Status run_later(State& state, const StaticFindings& findings) {
  state.with_statics = false;
  state.views = motion_views(state);
  STGS_TRY(find_all_motion(state));
  for (std::size_t i = 0; i < state.views.size(); ++i) {
    const std::string& name = state.views[i].camera->name;
    if (std::find(findings.agreeing.begin(), findings.agreeing.end(), name) ==
        findings.agreeing.end())
      continue;
    state.agreeing.push_back(state.views[i]);
    state.agreeing_motion.push_back(state.motion[i]);
  }
  if (state.agreeing.size() != findings.agreeing.size())
    return runtime_error("the analysis of the first window is of other cameras");
  state.scene.range = findings.range;
  state.scene.focus = findings.focus;
  state.scene.surfaces = findings.surfaces;
  set_bounds_from(findings.bounds, state.capture);
  STGS_TRY(find_dynamic(state));
  STGS_TRY(find_velocities(state));
  collect_points(state);
  state.static_points = findings.points;
  STGS_TRY(hand_over_points(state));
  log_times(state.work.timings(), log_of(state));
  return {};
}

}  // namespace

Status initialise(PreparedCapture& capture, const InitSettings& settings,
                  const ProgressSink& progress, const LogSink& log,
                  std::shared_ptr<const StaticFindings>* findings) {
  State state{capture, settings, Work(progress, log)};
  const Status status = guarded("initialisation", [&] { return run(state); });
  if (status.ok() && findings != nullptr) *findings = findings_of(state);
  return status;
}

Status initialise_later(PreparedCapture& capture, const InitSettings& settings,
                        const StaticFindings& findings, const ProgressSink& progress,
                        const LogSink& log) {
  State state{capture, settings, Work(progress, log)};
  return guarded("initialisation", [&] { return run_later(state, findings); });
}

}  // namespace stgs::encoder
