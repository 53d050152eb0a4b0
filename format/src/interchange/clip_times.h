// SPDX-License-Identifier: Apache-2.0
// Timing of files that store times relative to the clip: 0 is the first frame, 1 the last one.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "interchange/import.h"
#include "stgs/format/timed_formats.h"

namespace stgs {

struct ClipTimes {
  std::uint32_t frames = 1;
  TimeBase frame_time{1, 30};

  // Returns the tick of time 1; a clip of one frame has that of time 0 to 1.
  double last_tick() const { return std::max(1.0, frames - 1.0); }
};

// Combines the values that a file states with those of the caller. kUsage if both are given.
inline Result<ClipTimes> clip_times(std::optional<std::uint32_t> frames, std::optional<double> fps,
                                    const std::string& name, const ClipSettings& settings) {
  if (settings.frames && frames) {
    return usage_error("{}: the file states its number of frames ({}); omit the frame count", name,
                       *frames);
  }
  if (settings.frame_time && fps) {
    return usage_error("{}: the file states its frame rate ({:.6g} fps); omit the frame rate", name,
                       *fps);
  }
  if (settings.frames == 0u) {
    return usage_error("invalid frame count (expected at least 1, got 0)");
  }
  ClipTimes times;
  times.frames = frames ? *frames : settings.frames.value_or(300);
  times.frame_time = fps ? frame_time_of(*fps) : settings.frame_time.value_or(TimeBase{1, 30});
  return times;
}

// Returns the scene of a clip.
inline Scene clip_scene(const ClipTimes& times, Gaussians4D set) {
  Scene scene;
  scene.metadata.time_base = times.frame_time;
  scene.metadata.frames = times.frames;
  scene.gaussians = std::move(set);
  return scene;
}

// Makes primitive i visible in one frame of the clip, from half a frame before it to half a frame
// after it; the last one to the end of the clip.
inline void set_single_frame(Gaussians4D& set, std::size_t i, std::uint32_t frame,
                             std::uint32_t frames) {
  const double begin = frame - 0.5;
  const double end = frame + 1 == frames ? frames + 0.5 : frame + 0.5 - kEdgeWidth;
  set.time[i] = static_cast<float>((begin + end) / 2);
  set.radius[i] = static_cast<float>((end - begin) / 2);
  set.sigma[i] = static_cast<float>(kEdgeSigma);
}

}  // namespace stgs
