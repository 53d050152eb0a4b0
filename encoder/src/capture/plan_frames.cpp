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
#include "write_frames.h"

namespace stgs::encoder {
namespace {

// Depth needs a second view.
constexpr std::size_t kMinTrainingCameras = 2;

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

Status choose_range(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                    const PrepareSettings& settings, PreparedCapture& capture) {
  const auto shorter = [](const FrameInfo& a, const FrameInfo& b) { return a.frames < b.frames; };
  const auto [shortest, longest] = std::minmax_element(infos.begin(), infos.end(), shorter);
  const std::string& short_name = source.cameras[shortest - infos.begin()].name;
  const std::string& long_name = source.cameras[longest - infos.begin()].name;
  const int first = settings.first_frame;
  if (settings.end_frame < 0 && shortest->frames != longest->frames) {
    return invalid_file(
        "{}: the cameras are not synchronised: camera '{}' has {}, camera '{}' has {}; trim the "
        "capture, or select frames that all cameras have (--frames {}:{})",
        source.folder, short_name, plural(shortest->frames, "frame"), long_name, longest->frames,
        std::min(first, shortest->frames - 1), shortest->frames);
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
  for (const SourceCamera& camera : source.cameras) {
    if (camera.masks.empty() || static_cast<int>(camera.masks.size()) >= end) continue;
    return io_error("{}: camera '{}' has {} for frames {}:{}; frame {} is the first without one",
                    source.folder, camera.name, plural(camera.masks.size(), "mask"), first, end,
                    camera.masks.size());
  }
  capture.first_frame = first;
  capture.frames = end - first;
  return {};
}

Status choose_rate(const SourceCapture& source, const std::vector<FrameInfo>& infos,
                   const PrepareSettings& settings, PreparedCapture& capture, const LogSink& log) {
  double fps = 0;
  std::size_t from = 0;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    if (infos[i].fps <= 0) continue;
    if (fps > 0 && std::abs(infos[i].fps - fps) > 1e-3 * fps) {
      return invalid_file(
          "{}: the cameras are not synchronised: camera '{}' has {:.3f} fps, camera '{}' has "
          "{:.3f} fps; convert the videos to one frame rate",
          source.folder, source.cameras[i].name, infos[i].fps, source.cameras[from].name, fps);
    }
    if (fps == 0) fps = infos[i].fps, from = i;
  }
  if (fps == 0) fps = source.fps;
  if (settings.fps > 0 && fps > 0 && std::abs(settings.fps - fps) > 1e-3 * fps) {
    log(1, fmt::format("{}: --fps {:.3f} overrides the stated {:.3f} fps", source.folder,
                       settings.fps, fps));
  }
  if (settings.fps > 0) fps = settings.fps;
  if (fps == 0) {
    fps = 30;
    log(1, source.folder + ": no frame rate stated; assuming 30 fps (set it with --fps)");
  }
  if (!(fps >= 0.001 && fps <= 100000)) {
    return invalid_file("{}: invalid frame rate {} fps (expected 0.001 to 100000)", source.folder,
                        fps);
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
      STGS_ASSIGN([[maybe_unused]] const std::string path,
                  init::find_flow(*source.files, source.flow_folder, camera.name,
                                  capture.first_frame + frame));
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
  STGS_TRY(choose_range(source, infos, settings, capture));
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
  STGS_TRY(split(source, settings, capture));
  STGS_TRY(check_flow(source, capture));
  capture.frame_extension = extension_of(source, plans);
  capture.protocol = settings.protocol;
  return plans;
}

}  // namespace stgs::encoder
