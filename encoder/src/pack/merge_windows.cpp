// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "stgs/encoder/windows.h"

namespace stgs::encoder {
namespace {

// How far a background may be from another of the same capture, a channel, of 255: it is a median
// of 8-bit values, which rounding on another machine can move.
constexpr float kBackgroundTolerance = 4;

FrameSpan span_of(const Scene& scene) {
  const auto begin = static_cast<int>(scene.metadata.window->first_frame);
  return {begin, begin + static_cast<int>(scene.metadata.frames)};
}

// That `b`, which does not begin before `a`, may follow it.
Status check_pair(const WindowScene& a, const WindowScene& b) {
  const SceneMetadata &first = a.scene.metadata, &second = b.scene.metadata;
  if (first.window->capture != second.window->capture ||
      first.window->capture_frames != second.window->capture_frames ||
      !(first.time_base == second.time_base)) {
    return usage_error("{} and {}: are windows of different captures", a.name, b.name);
  }
  if (a.scene.gaussians.sh_degree != b.scene.gaussians.sh_degree) {
    return usage_error("{} has harmonics of degree {}, {} of degree {}: train all windows alike",
                       a.name, a.scene.gaussians.sh_degree, b.name, b.scene.gaussians.sh_degree);
  }
  if (first.window->training != second.window->training) {
    return usage_error("{} and {}: were trained with different settings; train all windows alike",
                       a.name, b.name);
  }
  const FrameSpan before = span_of(a.scene), after = span_of(b.scene);
  if (before.begin == after.begin || after.end <= before.end) {
    return usage_error("{} (frames {}:{}) and {} (frames {}:{}): one window lies in the other",
                       a.name, before.begin, before.end, b.name, after.begin, after.end);
  }
  if (after.begin > before.end) {
    return usage_error("frames {}:{} are missing between {} and {}", before.end, after.begin,
                       a.name, b.name);
  }
  return {};
}

std::string background_text(const SceneMetadata& scene) {
  const float* b = scene.background;
  return fmt::format("{:.0f} {:.0f} {:.0f}", 255 * b[0], 255 * b[1], 255 * b[2]);
}

// That what is shown where windows have nothing is the first one's, as nearly as nobody sees.
Status check_backgrounds(const std::vector<WindowScene>& windows, const LogSink& log) {
  const WindowScene& first = windows.front();
  float largest = 0;
  for (const WindowScene& window : windows) {
    for (std::size_t c = 0; c < 3; ++c) {
      const float other = 255 * window.scene.metadata.background[c];
      const float difference = std::abs(other - 255 * first.scene.metadata.background[c]);
      largest = std::max(largest, difference);
      if (difference <= kBackgroundTolerance) continue;
      return usage_error(
          "{} and {}: were trained with the same settings, but before other backgrounds, {} and {} "
          "of 255, so the capture's pictures or points have changed in between; train all windows "
          "on the same",
          first.name, window.name, background_text(first.scene.metadata),
          background_text(window.scene.metadata));
    }
  }
  if (largest > 0 && log) {
    log(2, fmt::format("the windows' backgrounds differ by up to {:.2g} of 255; {} of {} is taken",
                       largest, background_text(first.scene.metadata), first.name));
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
    return usage_error("frames 0:{} are missing before {}", first.begin, windows.front().name);
  }
  if (last.end != frames) {
    return usage_error("frames {}:{} are missing after {}", last.end, frames, windows.back().name);
  }
  return {};
}

// Where the earlier window ends and the later begins: between two frames, in the middle of what
// they share, so that each is drawn where it had seen frames on both sides.
double seam_of(const Scene& before, const Scene& after) {
  const int begin = span_of(after).begin, shared = span_of(before).end - begin;
  return begin + shared / 2 - 0.5;
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

bool comes_before(const Scene& a, const Scene& b) {
  const std::optional<CaptureWindow>&first = a.metadata.window, &second = b.metadata.window;
  return first && second ? first->first_frame < second->first_frame : !first && second;
}

Result<Scene> merge_windows(std::vector<WindowScene> windows, const LogSink& log) {
  if (windows.size() < 2) return usage_error("at least two windows are needed to merge them");
  for (const WindowScene& window : windows) {
    if (window.scene.metadata.window) continue;
    return usage_error(
        "{}: is no window of a capture; only scenes trained with --frames or --window are merged",
        window.name);
  }
  std::stable_sort(windows.begin(), windows.end(), [](const WindowScene& a, const WindowScene& b) {
    return comes_before(a.scene, b.scene);
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
  // Where one window does not know, they cannot be compared.
  if (merged.importance.size() != merged.gaussians.size()) merged.importance.clear();
  return merged;
}

}  // namespace stgs::encoder
