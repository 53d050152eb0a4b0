// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "frame_numbers.h"
#include "init/motion.h"
#include "plural.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/format/parallel.h"
#include "timing_file.h"
#include "write_frames.h"

namespace stgs::encoder {
namespace {

// Depth needs a second view.
constexpr std::size_t kMinTrainingCameras = 2;
constexpr int kMaxSourceFrames = 1'000'000'000;  // beyond the last frame of every camera
constexpr double kMinRateShare = 0.1;            // of a camera's own rate in that of the capture

Result<std::vector<FrameInfo>> probe_all(const SourceCapture& source) {
  const std::size_t count = source.cameras.size();
  std::vector<std::optional<Result<FrameInfo>>> found(count);
  parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    try {
      found[i] = probe_frames(*source.files, source.cameras[i]);
    } catch (const std::exception& error) {
      found[i] = invalid_file("camera '{}': {}", source.cameras[i].name, error.what());
    }
  });
  std::vector<FrameInfo> infos;
  for (auto& info : found) {
    STGS_ASSIGN(FrameInfo checked, *std::move(info));
    infos.push_back(checked);
  }
  return infos;
}

// Returns the frames of the capture that a camera has, of its `images`.
FrameSpan frames_of(const PreparedCapture& capture, const Camera& camera, int images) {
  // The first frame whose image is not before image `own`.
  const auto first = [&](int own) {
    int low = 0, high = kMaxSourceFrames;
    while (low < high) {
      const int middle = low + (high - low) / 2;
      if (capture.own_frame(camera, middle) < own) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return low;
  };
  return {first(0), first(images)};
}

// Checks the selected frames of synchronised cameras.
Status check_range(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                   const PrepareSettings& settings) {
  const auto shorter = [](const FrameInfo& a, const FrameInfo& b) { return a.frames < b.frames; };
  const auto [shortest, longest] = std::minmax_element(infos.begin(), infos.end(), shorter);
  const std::string& short_name = source.cameras[shortest - infos.begin()].name;
  const std::string& long_name = source.cameras[longest - infos.begin()].name;
  const int first = settings.first_frame;
  if (settings.end_frame < 0 && shortest->frames != longest->frames) {
    return invalid_file(
        "{}: the cameras are not synchronised: camera '{}' has {}, camera '{}' has {}; trim the "
        "capture, select frames that all cameras have (--frames {}:{}), or state the times of the "
        "cameras in {}",
        source.folder, short_name, plural(shortest->frames, "frame"), long_name, longest->frames,
        std::min(first, shortest->frames - 1), shortest->frames, kTimingFile);
  }
  const int end = settings.end_frame < 0 ? shortest->frames : settings.end_frame;
  if (end > shortest->frames && !settings.protocol.empty()) {
    return invalid_file("{}: protocol {} needs the first {}, but camera '{}' has {}", source.folder,
                        settings.protocol, plural(end, "frame"), short_name, shortest->frames);
  }
  if (end > shortest->frames || first >= end) {
    return usage_error(
        "{}: frames {}:{} are out of range: camera '{}' has {}; choose others with "
        "--frames",
        source.folder, first, end, short_name, plural(shortest->frames, "frame"));
  }
  return {};
}

// Returns the frames that all cameras have.
Result<FrameSpan> common_frames(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                                const PreparedCapture& capture) {
  FrameSpan common{0, kMaxSourceFrames};
  std::size_t last = 0, shortest = 0;  // the cameras with the latest begin and the earliest end
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const FrameSpan span = frames_of(capture, capture.cameras[i], infos[i].frames);
    if (span.begin > common.begin) common.begin = span.begin, last = i;
    if (span.end < common.end) common.end = span.end, shortest = i;
  }
  if (common.size() > 0) return common;
  return invalid_file(
      "{}: camera '{}' begins at frame {} of the capture, after camera '{}' ends at frame {}; "
      "correct their times in {}",
      source.folder, capture.cameras[last].name, common.begin, capture.cameras[shortest].name,
      common.end, kTimingFile);
}

// Returns the selected frames of cameras that state their times.
Result<FrameSpan> choose_common(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                                const PrepareSettings& settings, const PreparedCapture& capture,
                                const LogSink& log) {
  STGS_ASSIGN(const FrameSpan common, common_frames(source, infos, capture));
  const bool all = settings.end_frame < 0;
  const FrameSpan chosen{all ? std::max(settings.first_frame, common.begin) : settings.first_frame,
                         all ? common.end : settings.end_frame};
  if (chosen.begin < common.begin || chosen.end > common.end || chosen.size() < 1) {
    return usage_error(
        "{}: frames {}:{} are out of range: the cameras have frames {}:{} in common; choose others "
        "with --frames",
        source.folder, chosen.begin, chosen.end, common.begin, common.end);
  }
  if (chosen.size() > kCaptureLimits.frames) {
    return invalid_file(
        "{}: the cameras have frames {}:{} in common (expected at most {}); select "
        "some with --frames",
        source.folder, common.begin, common.end, kCaptureLimits.frames);
  }
  log(2, fmt::format("{}: the cameras have frames {}:{} in common", source.folder, common.begin,
                     common.end));
  return chosen;
}

Status choose_range(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                    const PrepareSettings& settings, PreparedCapture& capture, const LogSink& log) {
  FrameSpan chosen{settings.first_frame, settings.end_frame};
  if (source.has_timing) {
    STGS_ASSIGN(chosen, choose_common(source, infos, settings, capture, log));
  } else {
    STGS_TRY(check_range(source, infos, settings));
    if (chosen.end < 0) chosen.end = infos.front().frames;
  }
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SourceCamera& camera = source.cameras[i];
    const std::int64_t last = capture.own_frame(capture.cameras[i], chosen.end - 1);
    if (camera.masks.empty() || std::ssize(camera.masks) > last) continue;
    return io_error("{}: camera '{}' has {} for frames {}:{}; frame {} is the first without one",
                    source.folder, camera.name, plural(camera.masks.size(), "mask"), chosen.begin,
                    chosen.end, camera.masks.size());
  }
  capture.first_frame = chosen.begin;
  capture.frames = chosen.size();
  return {};
}

// Returns the frame rate of the cameras that state none of their own, else the highest; 0: unknown.
Result<double> stated_rate(const SourceCapture& source, const std::vector<FrameInfo>& infos) {
  double fps = 0, own = 0;
  std::size_t from = 0;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    own = std::max(own, source.cameras[i].fps);
    if (infos[i].fps <= 0 || source.cameras[i].fps > 0) continue;
    if (fps > 0 && std::abs(infos[i].fps - fps) > 1e-3 * fps) {
      return invalid_file(
          "{}: the cameras are not synchronised: camera '{}' has {:.3f} fps, camera '{}' has "
          "{:.3f} fps; convert the videos to one frame rate, or state the rate of cameras that "
          "differ in {}",
          source.folder, source.cameras[i].name, infos[i].fps, source.cameras[from].name, fps,
          kTimingFile);
    }
    if (fps == 0) fps = infos[i].fps, from = i;
  }
  if (fps == 0) fps = source.fps;
  return fps > 0 ? fps : own;
}

Status choose_rate(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                   const PrepareSettings& settings, PreparedCapture& capture, const LogSink& log) {
  STGS_ASSIGN(double fps, stated_rate(source, infos));
  if (settings.fps > 0 && fps > 0 && std::abs(settings.fps - fps) > 1e-3 * fps) {
    log(1, fmt::format("{}: --fps {:.3f} overrides the stated {:.3f} fps", source.folder,
                       settings.fps, fps));
  }
  if (settings.fps > 0) fps = settings.fps;
  if (fps == 0) {
    fps = 30;
    log(1, source.folder + ": no frame rate stated; assuming 30 fps (set it with --fps)");
  }
  if (!(fps >= kMinFps && fps <= kMaxFps)) {
    return invalid_file("{}: invalid frame rate {} fps (expected {} to {})", source.folder, fps,
                        kMinFps, kMaxFps);
  }
  for (const SourceCamera& camera : source.cameras) {
    if (camera.fps == 0 || camera.fps >= kMinRateShare * fps) continue;
    return invalid_file(
        "{}/{}: camera '{}' has {} fps, less than a tenth of the {} fps of the "
        "capture; lower that with --fps, or leave the camera out",
        source.folder, kTimingFile, camera.name, camera.fps, fps);
  }
  capture.time_base = frame_time_of(fps);
  return {};
}

Status split(const SourceCapture& source, const PrepareSettings& settings,
             PreparedCapture& capture) {
  const bool own = settings.default_test_cameras && settings.test_cameras.empty();
  for (std::size_t i = 0; i < capture.cameras.size(); ++i) {
    capture.cameras[i].test = own && source.cameras[i].test;
  }
  for (const std::string& name : settings.test_cameras) {
    const auto it = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                 [&](const Camera& camera) { return camera.name == name; });
    if (it == capture.cameras.end()) {
      std::string names;
      for (const Camera& camera : capture.cameras) names += " " + camera.name;
      return usage_error("{}: no camera '{}' to hold out (--test-cameras); the cameras are{}",
                         source.folder, name, names);
    }
    it->test = true;
  }
  const auto trains = [](const Camera& camera) { return !camera.test; };
  const auto count = std::count_if(capture.cameras.begin(), capture.cameras.end(), trains);
  if (count >= static_cast<std::ptrdiff_t>(kMinTrainingCameras)) return {};
  return usage_error(
      "{}: {} left for training after holding out {} (expected at least {}); hold out fewer with "
      "--test-cameras",
      source.folder, plural(count, "camera"), capture.cameras.size() - count, kMinTrainingCameras);
}

// Checks that every training camera with given flow has it for all frames, before the long work.
Status check_flow(const SourceCapture& source, const PreparedCapture& capture) {
  if (source.flow_folder.empty()) return {};
  for (const Camera& camera : capture.cameras) {
    for (int frame = 0; !camera.test && frame + 1 < capture.frames; ++frame) {
      const auto own = static_cast<int>(capture.own_frame(camera, frame));
      STGS_ASSIGN(const std::string path,
                  init::find_flow(*source.files, source.flow_folder, camera.name, own));
      if (path.empty() || camera.fps == 0) continue;
      return unsupported(
          "{}: optical flow of a camera with a frame rate of its own ({}); remove "
          "it",
          path, kTimingFile);
    }
  }
  return {};
}

// Returns "jpg" if all frames are unchanged JPEG files, else "png".
std::string extension_of(const SourceCapture& source, const std::vector<CameraPlan>& plans) {
  std::string common;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    if (!plans[i].is_identity() || source.cameras[i].images.empty()) return "png";
    for (const std::string& path : source.cameras[i].images) {
      std::string extension = std::filesystem::path(path).extension().string();
      for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      if (extension == ".jpeg") extension = ".jpg";
      if (common.empty()) common = extension;
      if (extension != common) return "png";
    }
  }
  return common == ".jpg" ? "jpg" : "png";
}

}  // namespace

Result<std::vector<CameraPlan>> plan_frames(const SourceCapture& source,
                                            const PrepareSettings& settings,
                                            PreparedCapture& capture, const LogSink& log) {
  STGS_TRY(check_camera_count(source.folder, source.cameras));
  STGS_TRY(check_frame_numbers(source, settings.end_frame, log));
  STGS_ASSIGN(const std::vector<FrameInfo> infos, probe_all(source));
  STGS_TRY(choose_rate(source, infos, settings, capture, log));
  std::vector<CameraPlan> plans;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SourceCamera& camera = source.cameras[i];
    STGS_ASSIGN(CameraPlan plan, plan_camera(camera, infos[i], settings.scale));
    STGS_TRY(check_camera(plan.camera, source.folder));  // before the long work
    if (plan.zoom > 1) {
      log(2, fmt::format("camera '{}': undistorted with zoom {:.3f} to avoid an empty border",
                         camera.name, plan.zoom));
    }
    if (plan.has_border) {
      log(1, fmt::format("camera '{}': undistortion leaves a border, which repeats the image edge",
                         camera.name));
    }
    capture.cameras.push_back(plan.camera);
    plans.push_back(std::move(plan));
  }
  STGS_TRY(choose_range(source, infos, settings, capture, log));
  STGS_TRY(split(source, settings, capture));
  STGS_TRY(check_flow(source, capture));
  capture.frame_extension = extension_of(source, plans);
  capture.protocol = settings.protocol;
  return plans;
}

}  // namespace stgs::encoder
