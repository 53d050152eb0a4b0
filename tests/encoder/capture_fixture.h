// SPDX-License-Identifier: Apache-2.0
// Writes tiny captures with known cameras into temporary folders.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "src/capture/source_capture.h"
#include "src/capture/write_frames.h"
#include "stgs/encoder/capture_folder.h"

namespace stgs::encoder::capture_test {

namespace fs = std::filesystem;
using testing::TemporaryFolder;

constexpr int kWidth = 64, kHeight = 48;

// Camera i of `count` on a circle of radius 3, looking at the origin; pixel centres are at +0.5.
inline Camera known_camera(int i, int count, const std::string& name) {
  Camera camera;
  camera.name = name;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = 60 + i;
  camera.fy = 61 + i;
  camera.cx = 32.25;
  camera.cy = 23.75;
  const double a = 2 * 3.141592653589793 * i / count + 0.1;
  const cv::Vec3d centre(3 * std::cos(a), 0.4, 3 * std::sin(a));
  const cv::Vec3d z = -centre / cv::norm(centre), down(0, 1, 0);
  const cv::Vec3d x = cv::normalize(down.cross(z)), y = z.cross(x);
  const cv::Matx33d r(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
  const cv::Vec3d t = -(r * centre);
  std::copy_n(r.val, 9, camera.rotation);
  std::copy_n(t.val, 3, camera.translation);
  return camera;
}

// Row-major 4x4.
inline std::vector<double> world_to_camera(const Camera& c) {
  const double* r = c.rotation;
  const double* t = c.translation;
  return {r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2], 0, 0, 0, 1};
}

inline cv::Vec3d centre_of(const double* rotation, const double* translation) {
  return -(cv::Matx33d(rotation).t() * cv::Vec3d(translation));
}

inline cv::Mat test_image(int camera, int frame, int width = kWidth, int height = kHeight) {
  cv::Mat image(height, width, CV_8UC3, cv::Scalar(20 + 10 * camera, 80, 120));
  cv::circle(image, {width / 4 + 3 * frame, height / 2}, height / 6, {200, 220, 40}, cv::FILLED);
  return image;
}

inline void write_image(const std::string& path, const cv::Mat& image) {
  fs::create_directories(fs::path(path).parent_path());
  cv::imwrite(path, image);
}

inline void write_images(const std::string& folder, int camera, int frames,
                         const std::string& extension = "png") {
  for (int f = 0; f < frames; ++f) {
    write_image(fmt::format("{}/{:06}.{}", folder, f, extension), test_image(camera, f));
  }
}

inline void write_video(const std::string& path, int camera, int frames, double fps = 30,
                        int width = kWidth, int height = kHeight) {
  fs::create_directories(fs::path(path).parent_path());
  cv::VideoWriter video(path, cv::VideoWriter::fourcc('m', 'p', '4', 'v'), fps, {width, height});
  for (int f = 0; f < frames; ++f) video.write(test_image(camera, f, width, height));
}

inline void write_text(const std::string& path, const std::string& text) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path) << text;
}

inline void write_bytes(const std::string& path, const std::string& bytes) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

template <typename T>
void append(std::string& bytes, T value) {
  const auto* p = reinterpret_cast<const char*>(&value);
  bytes.append(p, sizeof(T));
}

// Removes the last `bytes` bytes of a file.
inline void shorten(const std::string& path, std::uintmax_t bytes) {
  fs::resize_file(path, fs::file_size(path) - bytes);
}

inline std::shared_ptr<const CaptureFolder> files_of(const TemporaryFolder& folder) {
  return *CaptureFolder::open(folder.path, false);
}

inline std::vector<std::string>& log_lines() {
  static std::vector<std::string> lines;
  return lines;
}

inline Result<SourceCapture> load(const std::string& folder, PrepareSettings settings = {}) {
  log_lines().clear();
  return load_source(folder, settings, {},
                     [](int, const std::string& line) { log_lines().push_back(line); });
}

// Largest difference over rotation entries, translation (scene units) and intrinsics (pixels).
inline double difference(const SourceCamera& found, const Camera& expected) {
  double largest = 0;
  const auto add = [&](double a, double b) { largest = std::max(largest, std::abs(a - b)); };
  for (int i = 0; i < 9; ++i) add(found.rotation[i], expected.rotation[i]);
  for (int i = 0; i < 3; ++i) add(found.translation[i], expected.translation[i]);
  add(found.fx, expected.fx);
  add(found.fy, expected.fy);
  add(found.cx, expected.cx);
  add(found.cy, expected.cy);
  return largest;
}

inline const SourceCamera* find(const SourceCapture& capture, const std::string& name) {
  for (const SourceCamera& camera : capture.cameras) {
    if (camera.name == name) return &camera;
  }
  return nullptr;
}

// Whether `status` is an error whose message contains all `words`.
inline bool fails_with(const Status& status, const std::vector<std::string>& words) {
  for (const std::string& word : words) {
    if (status.message().find(word) == std::string::npos) {
      UNSCOPED_INFO("missing '" << word << "' in: " << status.message());
      return false;
    }
  }
  return !status.ok();
}

// An n3dv capture: videos cam00.mp4, cam01.mp4, ... and poses_bounds.npy.
inline void write_n3dv(const std::string& folder, int cameras, int frames) {
  std::vector<double> rows;
  for (int i = 0; i < cameras; ++i) {
    const Camera c = known_camera(i, cameras, "");
    const cv::Vec3d centre = centre_of(c.rotation, c.translation);
    for (int k = 0; k < 3; ++k) {  // columns: down, right, backward, centre, height width focal
      const double hwf[3] = {kHeight, kWidth, c.fx};
      rows.insert(rows.end(),
                  {c.rotation[3 + k], c.rotation[k], -c.rotation[6 + k], centre[k], hwf[k]});
    }
    rows.insert(rows.end(), {0.5, 9.0});
    write_video(fmt::format("{}/cam{:02}.mp4", folder, i), i, frames);
  }
  std::string header =
      fmt::format("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}", cameras);
  header.resize(117, ' ');
  header += '\n';
  std::string bytes = std::string("\x93NUMPY\x01\0\x76\0", 10) + header;
  for (double v : rows) append(bytes, v);
  write_bytes(folder + "/poses_bounds.npy", bytes);
}

inline std::string json_list(const std::vector<double>& numbers) {
  std::string text = "[";
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    text += fmt::format("{}{:.12g}", i == 0 ? "" : ",", numbers[i]);
  }
  return text + "]";
}

inline std::vector<double> matrix_k(const Camera& c, double pixel_centre = 0.5) {
  const double shift = pixel_centre - 0.5;
  return {c.fx, 0, c.cx + shift, 0, c.fy, c.cy + shift, 0, 0, 1};
}

inline std::string yaml_matrix(const std::string& name, int rows, int columns,
                               const std::vector<double>& data) {
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: {}\n", name,
                     rows, columns, json_list(data));
}

inline void write_easyvolcap(const TemporaryFolder& folder, int cameras, int frames, bool videos) {
  std::string intri = "%YAML:1.0\n---\nnames:\n";
  for (int i = 0; i < cameras; ++i) intri += fmt::format("   - \"{:02}\"\n", i);
  std::string extri = intri;
  for (int i = 0; i < cameras; ++i) {
    const Camera c = known_camera(i, cameras, "");
    const std::string name = fmt::format("{:02}", i);
    intri += yaml_matrix("K_" + name, 3, 3, matrix_k(c, 0));
    intri += yaml_matrix((i % 2 ? "D_" : "dist_") + name, 5, 1, {-0.1, 0.01, 0, 0, 0});
    extri += yaml_matrix("Rot_" + name, 3, 3, std::vector<double>(c.rotation, c.rotation + 9));
    extri += yaml_matrix("T_" + name, 3, 1, std::vector<double>(c.translation, c.translation + 3));
    if (videos) {
      write_video(folder / fmt::format("videos/{}.mp4", name), i, frames);
    } else {
      write_images(folder / ("images/" + name), i, frames, "jpg");
    }
  }
  write_text(folder / "intri.yml", intri);
  write_text(folder / "extri.yml", extri);
}

// transforms.json with the files of each frame, in the order of the cameras c0, c1, ...
inline void write_transforms(const std::string& folder, const std::vector<std::string>& files,
                             std::size_t cameras = 10'000) {
  std::string frames;
  for (std::size_t i = 0; i < files.size(); ++i) {
    frames += fmt::format(
        "{}{{\"file_path\":\"{}\",\"camera\":\"c{}\","
        "\"transform_matrix\":[[1,0,0,{}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}",
        i == 0 ? "" : ",", files[i], i % cameras, i % cameras);
  }
  write_text(folder + "/transforms.json",
             "{\"fl_x\":60,\"w\":64,\"h\":48,\"frames\":[" + frames + "]}");
}

}  // namespace stgs::encoder::capture_test
