// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "stgs/encoder/windows.h"

namespace stgs::encoder {
namespace {

// Maximum difference per channel, of 255, between backgrounds of the same capture. A background is
// a median of 8-bit values, which can shift with rounding on another machine.
constexpr float kBackgroundTolerance = 4;

FrameSpan span_of(const Scene& scene) {
  const auto begin = static_cast<int>(scene.metadata.window->first_frame);
  return {begin, begin + static_cast<int>(scene.metadata.frames)};
}

// Checks that `b`, which does not begin before `a`, can follow it.
Status check_pair(const WindowScene& a, const WindowScene& b) {
  const SceneMetadata &first = a.scene.metadata, &second = b.scene.metadata;
  if (first.window->capture != second.window->capture ||
      first.window->capture_frames != second.window->capture_frames ||
      !(first.time_base == second.time_base)) {
    return usage_error("{} and {}: windows of different captures; merge windows of one capture",
                       a.name, b.name);
  }
  if (a.scene.gaussians.sh_degree != b.scene.gaussians.sh_degree) {
    return usage_error(
        "{} and {}: different SH degrees ({} and {}); train all windows with the same settings",
        a.name, b.name, a.scene.gaussians.sh_degree, b.scene.gaussians.sh_degree);
  }
  if (first.window->training != second.window->training) {
    return usage_error(
        "{} and {}: trained with different settings; train all windows with the same settings",
        a.name, b.name);
  }
  const FrameSpan before = span_of(a.scene), after = span_of(b.scene);
  if (before.begin == after.begin || after.end <= before.end) {
    return usage_error(
        "{} (frames {}:{}) and {} (frames {}:{}): one window contains the other; remove one",
        a.name, before.begin, before.end, b.name, after.begin, after.end);
  }
  if (after.begin > before.end) {
    return usage_error("frames {}:{} are missing between {} and {}; add their window", before.end,
                       after.begin, a.name, b.name);
  }
  return {};
}

std::string background_text(const SceneMetadata& scene) {
  const float* b = scene.background;
  return fmt::format("{:.0f} {:.0f} {:.0f}", 255 * b[0], 255 * b[1], 255 * b[2]);
}

// Checks that all backgrounds are visually identical to the first one.
Status check_backgrounds(const std::vector<WindowScene>& windows, const LogSink& log) {
  const WindowScene& first = windows.front();
  float max_difference = 0;
  for (const WindowScene& window : windows) {
    for (std::size_t c = 0; c < 3; ++c) {
      const float other = 255 * window.scene.metadata.background[c];
      const float difference = std::abs(other - 255 * first.scene.metadata.background[c]);
      max_difference = std::max(max_difference, difference);
      if (difference <= kBackgroundTolerance) continue;
      return usage_error(
          "{} and {}: trained with the same settings, but different backgrounds ({} and {} of "
          "255), "
          "because the capture's images or points changed in between; train all windows on the "
          "same "
          "capture",
          first.name, window.name, background_text(first.scene.metadata),
          background_text(window.scene.metadata));
    }
  }
  if (max_difference > 0 && log) {
    log(2, fmt::format("the windows' backgrounds differ by up to {:.2g} of 255; using {} of {}",
                       max_difference, background_text(first.scene.metadata), first.name));
  }
  return {};
}

Status check(const std::vector<WindowScene>& windows) {
  for (std::size_t i = 1; i < windows.size(); ++i) {
    STGS_TRY(check_pair(windows[i - 1], windows[i]));
  }
  const FrameSpan first = span_of(windows.front().scene), last = span_of(windows.back().scene);
  const auto frames = static_cast<int>(windows.front().scene.metadata.window->capture_frames);
  if (first.begin != 0) {
    return usage_error("frames 0:{} are missing before {}; add their window", first.begin,
                       windows.front().name);
  }
  if (last.end != frames) {
    return usage_error("frames {}:{} are missing after {}; add their window", last.end, frames,
                       windows.back().name);
  }
  return {};
}

// Returns the time at which the earlier window ends and the later one begins: between two frames,
// in the middle of their overlap, so that each is rendered only where it was trained on both sides.
double seam_of(const Scene& before, const Scene& after) {
  const int begin = span_of(after).begin, shared = span_of(before).end - begin;
  const int seam = begin + shared / 2;
  return seam - 0.5;
}

void append(const Gaussians4D& from, float shift, Gaussians4D& to) {
  const auto add = [](const auto& more, auto& all) {
    all.insert(all.end(), more.begin(), more.end());
  };
  const std::size_t first = to.size();
  add(from.position, to.position);
  add(from.log_scale, to.log_scale);
  add(from.rotation, to.rotation);
  add(from.opacity_logit, to.opacity_logit);
  add(from.sh, to.sh);
  add(from.time, to.time);
  add(from.velocity, to.velocity);
  add(from.sigma, to.sigma);
  add(from.radius, to.radius);
  for (std::size_t i = first; i < to.size(); ++i) to.time[i] += shift;
}

}  // namespace

bool starts_before(const Scene& a, const Scene& b) {
  const std::optional<CaptureWindow>&first = a.metadata.window, &second = b.metadata.window;
  return first && second ? first->first_frame < second->first_frame : !first && second;
}

Result<Scene> merge_windows(std::vector<WindowScene> windows, const LogSink& log) {
  if (windows.size() < 2) return usage_error("at least two windows are required for merging");
  for (const WindowScene& window : windows) {
    if (window.scene.metadata.window) continue;
    return usage_error(
        "{}: not a window of a capture; merge scenes trained with --frames or --window",
        window.name);
  }
  std::stable_sort(windows.begin(), windows.end(), [](const WindowScene& a, const WindowScene& b) {
    return starts_before(a.scene, b.scene);
  });
  STGS_TRY(check(windows));
  STGS_TRY(check_backgrounds(windows, log));
  Scene merged;
  merged.metadata = windows.front().scene.metadata;
  merged.metadata.frames = merged.metadata.window->capture_frames;
  merged.metadata.window.reset();
  merged.gaussians.sh_degree = windows.front().scene.gaussians.sh_degree;
  double begin = 0;
  for (std::size_t i = 0; i < windows.size(); ++i) {
    const Scene& scene = windows[i].scene;
    const double end = i + 1 < windows.size() ? seam_of(scene, windows[i + 1].scene)
                                              : static_cast<double>(merged.metadata.frames);
    append(scene.gaussians, static_cast<float>(span_of(scene).begin - begin), merged.gaussians);
    merged.importance.insert(merged.importance.end(), scene.importance.begin(),
                             scene.importance.end());
    merged.parts.push_back({begin, end, scene.gaussians.size()});
    begin = end;
  }
  // Without the importances of one window, those of the others cannot be compared.
  if (merged.importance.size() != merged.gaussians.size()) merged.importance.clear();
  return merged;
}

}  // namespace stgs::encoder
