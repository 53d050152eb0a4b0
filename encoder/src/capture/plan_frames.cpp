// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "frame_numbers.h"
#include "init/motion.h"
#include "stgs/format/parallel.h"
#include "write_frames.h"

namespace stgs::encoder {
namespace {

Result<std::vector<FrameInfo>> probe_all(const SourceCapture& source) {
  const std::size_t count = source.cameras.size();
  std::vector<std::optional<Result<FrameInfo>>> found(count);
  parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    try {
      found[i] = probe_frames(source.cameras[i]);
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
  const auto [least, most] = std::minmax_element(infos.begin(), infos.end(), shorter);
  const std::string& short_name = source.cameras[least - infos.begin()].name;
  const std::string& long_name = source.cameras[most - infos.begin()].name;
  const int first = settings.first_frame;
  if (settings.end_frame < 0 && least->frames != most->frames) {
    return invalid_file(
        "{}: camera '{}' has {} frames, but camera '{}' has {}: the capture is not "
        "synchronised; trim it, or ask for frames that all have (--frames {}:{})",
        source.folder, short_name, least->frames, long_name, most->frames,
        std::min(first, least->frames - 1), least->frames);
  }
  const int end = settings.end_frame < 0 ? least->frames : settings.end_frame;
  if (end > least->frames || first >= end) {
    return usage_error("{}: frames {}:{} are asked for, but camera '{}' has {} frames",
                       source.folder, first, end, short_name, least->frames);
  }
  for (const SourceCamera& camera : source.cameras) {
    if (camera.masks.empty() || static_cast<int>(camera.masks.size()) >= end) continue;
    return io_error(
        "{}: camera '{}' has {} masks, but frames {}:{} are asked for; frame {} is the "
        "first without one",
        source.folder, camera.name, camera.masks.size(), first, end, camera.masks.size());
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
          "{}: camera '{}' has {:.3f} frames a second, but camera '{}' has {:.3f}: "
          "the capture is not synchronised",
          source.folder, source.cameras[i].name, infos[i].fps, source.cameras[from].name, fps);
    }
    if (fps == 0) fps = infos[i].fps, from = i;
  }
  if (fps == 0) fps = source.fps;
  if (settings.fps > 0 && fps > 0 && std::abs(settings.fps - fps) > 1e-3 * fps) {
    log(1, fmt::format("{}: states {:.3f} frames a second; {:.3f} is used, as asked for",
                       source.folder, fps, settings.fps));
  }
  if (settings.fps > 0) fps = settings.fps;
  if (fps == 0) {
    fps = 30;
    log(1, source.folder + ": states no frame rate; 30 frames a second are assumed (--fps)");
  }
  if (!(fps >= 0.001 && fps <= 100000)) {
    return invalid_file("{}: {} frames a second make no sense", source.folder, fps);
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
      return usage_error("{}: has no camera '{}' to hold out; it has{}", source.folder, name,
                         names);
    }
    it->test = true;
  }
  const bool trains = std::any_of(capture.cameras.begin(), capture.cameras.end(),
                                  [](const Camera& camera) { return !camera.test; });
  if (!trains) return usage_error("{}: every camera is held out", source.folder);
  return {};
}

// A training camera with flow has it from every frame to the next; known before the work begins.
Status check_flow(const SourceCapture& source, const PreparedCapture& capture) {
  if (source.flow_folder.empty()) return {};
  for (const Camera& camera : capture.cameras) {
    for (int frame = 0; !camera.test && frame + 1 < capture.frames; ++frame) {
      STGS_ASSIGN([[maybe_unused]] const std::string path,
                  init::find_flow(source.flow_folder, camera.name, capture.first_frame + frame));
    }
  }
  return {};
}

// "jpg" or "png" if all frames can keep their bytes, else "png".
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
  STGS_TRY(check_frame_numbers(source, settings.end_frame, log));
  STGS_ASSIGN(const std::vector<FrameInfo> infos, probe_all(source));
  STGS_TRY(choose_range(source, infos, settings, capture));
  STGS_TRY(choose_rate(source, infos, settings, capture, log));
  std::vector<CameraPlan> plans;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SourceCamera& camera = source.cameras[i];
    STGS_ASSIGN(CameraPlan plan, plan_camera(camera, infos[i], settings.scale));
    if (plan.zoom > 1) {
      log(2, fmt::format("camera '{}': zoomed by {:.3f} so that undistortion leaves no border",
                         camera.name, plan.zoom));
    }
    if (plan.has_border) {
      log(1, fmt::format("camera '{}': its lens leaves borders after undistortion; they repeat the "
                         "picture's edge",
                         camera.name));
    }
    capture.cameras.push_back(plan.camera);
    plans.push_back(std::move(plan));
  }
  STGS_TRY(split(source, settings, capture));
  STGS_TRY(check_flow(source, capture));
  capture.frame_extension = extension_of(source, plans);
  return plans;
}

}  // namespace stgs::encoder
