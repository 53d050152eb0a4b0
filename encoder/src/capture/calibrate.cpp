// SPDX-License-Identifier: Apache-2.0
// Calibrates static cameras with COLMAP from one frame of each.
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "capture_files.h"
#include "colmap_model.h"
#include "frame_reader.h"
#include "plural.h"
#include "run_program.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::hours kTimeLimit{1};  // of all steps of COLMAP

Status make_folder(WorkFolder& folder, const LogSink& log) {
  const std::string name = (fs::temp_directory_path() / "stgs-calibrate").string();
  clear_leftovers(name, log);
  STGS_TRY(folder.create(name));
  fs::create_directory(folder.path() + "/images");
  fs::create_directory(folder.path() + "/sparse");
  return {};
}

Status write_first_frame(const CaptureFolder& files, const SourceCamera& camera, int frame,
                         const std::string& folder) {
  STGS_ASSIGN(const FrameInfo info, probe_frames(files, camera));
  if (frame >= info.frames) {
    return usage_error("camera '{}' has no frame {} (it has {}); choose others with --frames",
                       camera.name, frame, plural(info.frames, "frame"));
  }
  cv::Mat image;
  if (camera.video.empty()) {
    STGS_ASSIGN(image, read_image(files, camera, frame, info.width, info.height));
  } else {
    STGS_ASSIGN(const std::unique_ptr<VideoReader> video, VideoReader::open(files, camera, frame));
    STGS_ASSIGN(image, video->next(info.width, info.height));
  }
  const std::string path = folder + "/images/" + camera.name + ".png";
  if (!cv::imwrite(path, image)) return io_error("{}: cannot write the image", path);
  return {};
}

// Writes the reconstructions to sparse/. If the images share too few features there are none, and
// the mapper of COLMAP 3.8 exits with an error, which is logged and ignored.
Status run_colmap(const std::string& folder, const ProgressSink& progress, const LogSink& log) {
  const std::string database = folder + "/database.db", images = folder + "/images";
  const std::vector<std::vector<std::string>> commands = {
      {"colmap", "feature_extractor", "--database_path", database, "--image_path", images,
       "--ImageReader.camera_model", "SIMPLE_RADIAL", "--ImageReader.single_camera_per_image", "1",
       "--SiftExtraction.use_gpu", "0"},
      {"colmap", "exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", "0"},
      {"colmap", "mapper", "--database_path", database, "--image_path", images, "--output_path",
       folder + "/sparse"}};
  double done = 0;
  const auto deadline = std::chrono::steady_clock::now() + kTimeLimit;
  for (const std::vector<std::string>& command : commands) {
    int exit_code = 0;
    Status status = run_program(command, folder + "/log.txt", "calibrate", done, progress, deadline,
                                &exit_code);
    if (!status.ok() && (command[1] != "mapper" || exit_code <= 0)) return status;
    if (!status.ok()) log(1, status.message());
    done += 1.0 / static_cast<double>(commands.size());
  }
  return {};
}

// Returns the reconstruction with the most images. The mapper starts a new one whenever it cannot
// extend the current one.
Result<ColmapModel> best_model(const std::string& folder) {
  STGS_ASSIGN(const auto files, CaptureFolder::open(folder, false));
  STGS_ASSIGN(const std::vector<std::string> models, list_folders(*files, folder + "/sparse"));
  ColmapModel best;
  for (const std::string& path : models) {
    STGS_ASSIGN(ColmapModel model, read_colmap_model(*files, path));
    if (model.images.size() > best.images.size()) best = std::move(model);
  }
  return best;
}

}  // namespace

Status calibrate(int frame, SourceCapture& capture, const ProgressSink& progress,
                 const LogSink& log) {
  log(2, capture.folder + ": no calibration found; calibrating with COLMAP");
  WorkFolder folder;
  STGS_TRY(make_folder(folder, log));
  for (const SourceCamera& camera : capture.cameras) {
    STGS_TRY(write_first_frame(*capture.files, camera, frame, folder.path()));
  }
  STGS_TRY(run_colmap(folder.path(), progress, log));
  STGS_ASSIGN(ColmapModel model, best_model(folder.path()));
  SourceCapture placed;
  STGS_TRY(cameras_from_colmap(model, capture.folder, placed, nullptr));
  std::string unplaced;
  for (SourceCamera& camera : capture.cameras) {
    const auto it =
        std::find_if(placed.cameras.begin(), placed.cameras.end(),
                     [&](const SourceCamera& other) { return other.name == camera.name; });
    if (it == placed.cameras.end()) {
      unplaced += (unplaced.empty() ? "'" : ", '") + camera.name + "'";
      continue;
    }
    SourceCamera calibrated = *it;
    calibrated.video = camera.video;
    calibrated.images = std::move(camera.images);
    camera = std::move(calibrated);
  }
  if (!unplaced.empty()) {
    return runtime_error(
        "{}: COLMAP could not calibrate {} of {} ({}); add a calibration in cameras.json{}",
        capture.folder, capture.cameras.size() - placed.cameras.size(),
        plural(capture.cameras.size(), "camera"), unplaced,
        placed.cameras.empty() ? "" : ", or remove these cameras");
  }
  capture.points = std::move(model.points);
  log(2, fmt::format("{}: COLMAP calibrated {} with {}", capture.folder,
                     plural(capture.cameras.size(), "camera"),
                     plural(capture.points.size(), "point")));
  return {};
}

}  // namespace stgs::encoder
