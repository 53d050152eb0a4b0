// SPDX-License-Identifier: Apache-2.0
#include "init/colmap_points.h"

#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "capture/run_program.h"
#include "stgs/format/temporary.h"

namespace stgs::encoder::init {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxSide = 960;       // longer side of the images given to COLMAP, pixels
constexpr int kMaxFeatures = 1500;  // per image
constexpr double kMaxError = 1.5;   // reprojection error, pixels

// Runs the steps of COLMAP. A step is killed on timeout or when `abandoned` becomes true.
struct Colmap {
  std::string folder;  // for glog's files, which otherwise go to the system's temporary folder
  std::string log;
  int seconds = 0;  // limit per step
  const std::atomic<bool>& abandoned;

  Status run(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "colmap");
    const std::string step = arguments[0] + " " + arguments[1];
    arguments.insert(arguments.begin(), {"env", "GLOG_log_dir=" + folder});
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
    const ProgressSink should_continue = [&](const Progress&) { return !abandoned; };
    return run_program(arguments, log, step, 0, should_continue, deadline);
  }
};

// Writes the images, named so that COLMAP numbers them in the order of the views, and the masks of
// the usable pixels.
Status write_images(const PreparedCapture& capture, const std::vector<View>& views, bool masked,
                    const fs::path& folder) {
  fs::create_directories(folder / "images");
  fs::create_directories(folder / "masks");
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::string name = fmt::format("{:04}.png", i);
    STGS_ASSIGN(const cv::Mat image, load_image(capture, views[i], 0));
    STGS_TRY(write_png((folder / "images" / name).string(), image));
    cv::Mat usable(views[i].size(), CV_8U, cv::Scalar(255));
    if (masked) {
      STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, views[i], 0));
      if (!mask.empty()) usable = ~mask;
    }
    STGS_TRY(write_png((folder / "masks" / (name + ".png")).string(), usable));
  }
  return {};
}

// Returns the quaternion w x y z of a rotation, in COLMAP's convention.
cv::Vec4d quaternion_of(const cv::Matx33d& r) {
  // Starts from the largest component, which is never near 0.
  const double trace = r(0, 0) + r(1, 1) + r(2, 2);
  cv::Vec4d q;
  if (trace > 0) {
    q = {1 + trace, r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)};
  } else {
    const int i = r(0, 0) > r(1, 1) && r(0, 0) > r(2, 2) ? 0 : r(1, 1) > r(2, 2) ? 1 : 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    q[0] = r(k, j) - r(j, k);
    q[1 + i] = 1 + r(i, i) - r(j, j) - r(k, k);
    q[1 + j] = r(i, j) + r(j, i);
    q[1 + k] = r(i, k) + r(k, i);
  }
  return q * (1 / cv::norm(q));
}

// Writes the model of the known poses. Ids start at 1 in the order of the images, as in the
// database.
Status write_model(const std::vector<View>& views, const fs::path& folder) {
  fs::create_directories(folder);
  std::ofstream cameras(folder / "cameras.txt"), images(folder / "images.txt");
  std::ofstream points(folder / "points3D.txt");
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& v = views[i];
    const cv::Vec4d q = quaternion_of(v.rotation);
    cameras << fmt::format("{} PINHOLE {} {} {:.17g} {:.17g} {:.17g} {:.17g}\n", i + 1, v.width,
                           v.height, v.fx, v.fy, v.cx, v.cy);
    images << fmt::format(
        "{} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {} {:04}.png\n\n", i + 1, q[0],
        q[1], q[2], q[3], v.translation[0], v.translation[1], v.translation[2], i + 1, i);
  }
  cameras.flush();
  images.flush();
  points.flush();
  if (cameras && images && points) return {};
  return io_error("{}: cannot write the COLMAP model", folder.string());
}

Result<std::vector<SurfacePoint>> read_model(const fs::path& path, std::size_t min_track) {
  std::ifstream file(path);
  if (!file) return io_error("{}: not written by COLMAP", path.string());
  std::vector<SurfacePoint> points;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream row(line);
    std::uint64_t id = 0;
    SurfacePoint point;
    int rgb[3];
    double error = 0;
    row >> id >> point.position[0] >> point.position[1] >> point.position[2];
    row >> rgb[0] >> rgb[1] >> rgb[2] >> error;
    if (!row) return invalid_file("{}: not a point: '{}'", path.string(), line);
    std::size_t track = 0;
    for (std::uint64_t image = 0, feature = 0; row >> image >> feature;) ++track;
    if (error > kMaxError || track < min_track) continue;
    for (int k = 0; k < 3; ++k) point.colour[k] = cv::saturate_cast<std::uint8_t>(rgb[k]);
    points.push_back(point);
  }
  return points;
}

}  // namespace

bool colmap_installed() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (::access((folder + "/colmap").c_str(), X_OK) == 0) return true;
  }
  return false;
}

Result<std::vector<SurfacePoint>> colmap_points(const PreparedCapture& capture,
                                                const std::vector<View>& all, int max_views,
                                                bool masked, int seconds,
                                                const std::atomic<bool>& abandoned) {
  std::vector<View> views;
  for (const int i : spread(all, max_views)) views.push_back(make_view(*all[i].camera, kMaxSide));
  WorkFolder work;
  STGS_TRY(work.create(capture.folder + "/colmap"));
  const fs::path folder = work.path();
  STGS_TRY(write_images(capture, views, masked, folder));
  STGS_TRY(write_model(views, folder / "known"));
  fs::create_directories(folder / "out");
  const auto path = [&](const char* name) { return (folder / name).string(); };
  const Colmap colmap{folder.string(), path("log.txt"), seconds, abandoned};
  STGS_TRY(
      colmap.run({"feature_extractor", "--database_path", path("database.db"), "--image_path",
                  path("images"), "--ImageReader.mask_path", path("masks"),
                  "--ImageReader.camera_model", "PINHOLE", "--ImageReader.single_camera_per_image",
                  "1", "--SiftExtraction.use_gpu", "0", "--SiftExtraction.num_threads", "1",
                  "--SiftExtraction.max_num_features", std::to_string(kMaxFeatures)}));
  STGS_TRY(colmap.run({"exhaustive_matcher", "--database_path", path("database.db"),
                       "--SiftMatching.use_gpu", "0", "--SiftMatching.num_threads", "1"}));
  const Status triangulated = colmap.run(
      {"point_triangulator", "--database_path", path("database.db"), "--image_path", path("images"),
       "--input_path", path("known"), "--output_path", path("out"), "--clear_points", "1"});
  // COLMAP aborts if no point is left to refine.
  const bool no_points = triangulated.message().find("bundle_adjuster.Solve") != std::string::npos;
  if (no_points) return std::vector<SurfacePoint>{};
  STGS_TRY(triangulated);
  STGS_TRY(colmap.run({"model_converter", "--input_path", path("out"), "--output_path", path("out"),
                       "--output_type", "TXT"}));
  return read_model(folder / "out" / "points3D.txt", views.size() > 3 ? 3 : 2);
}

}  // namespace stgs::encoder::init
