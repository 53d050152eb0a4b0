// SPDX-License-Identifier: Apache-2.0
#include "calibration.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "camera_names.h"
#include "capture_files.h"
#include "plural.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMinCameras = 2;

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

std::string file_name(const std::string& path) {
  return lower(fs::path(path).filename().string());
}

bool contains(const std::string& text, std::string_view part) {
  return text.find(part) != std::string::npos;
}

bool is_one_of(const std::string& extension, std::initializer_list<const char*> known) {
  return std::any_of(known.begin(), known.end(), [&](const char* e) { return extension == e; });
}

// Returns true if the text has an element of this name, with or without attributes.
bool has_element(const std::string& text, const std::string& name) {
  return contains(text, "<" + name + ">") || contains(text, "<" + name + " ");
}

bool is_qualisys(const CaptureFolder& files, const std::string& path) {
  const std::string name = file_name(path), extension = fs::path(name).extension().string();
  if (contains(name, ".qca.") && is_one_of(extension, {".txt", ".xml"})) return true;
  if (!contains(name, "calib") || extension != ".xml") return false;
  const Result<std::vector<std::uint8_t>> bytes = read_table(files, path);
  return bytes.ok() && has_element(std::string(bytes->begin(), bytes->end()), "calibration");
}

bool is_toml_calibration(const CaptureFolder&, const std::string& path) {
  const std::string name = file_name(path);
  return contains(name, "calib") && fs::path(name).extension() == ".toml";
}

bool may_be_opencv(const std::string& name) {
  return is_one_of(fs::path(name).extension().string(), {".yml", ".yaml", ".json", ".xml"});
}

// Returns true for names that suggest a calibration in whatever format.
bool suggests_calibration(const std::string& name) {
  const std::string extension = fs::path(name).extension().string();
  if (is_one_of(extension, {".xcp", ".calib"})) return true;
  const bool data = is_one_of(extension, {".toml", ".xml", ".yml", ".yaml", ".json", ".txt", ".csv",
                                          ".pickle", ".pkl", ".npy", ".npz", ".mat"});
  return data && (contains(name, "calib") || contains(name, "camera") || contains(name, "intri") ||
                  contains(name, "extri"));
}

std::string list_names(const std::vector<SourceCamera>& cameras) {
  std::string names;
  for (const SourceCamera& camera : cameras) {
    names += (names.empty() ? "'" : ", '") + camera.name + "'";
  }
  return names;
}

// Returns the only candidate, or an empty path. kInvalidFile if there are several.
Result<std::string> only_one(const CaptureFolder& files, const std::vector<std::string>& paths,
                             bool (*is_kind)(const CaptureFolder& files, const std::string& path)) {
  std::string found;
  for (const std::string& path : paths) {
    if (!is_kind(files, path)) continue;
    if (!found.empty()) {
      return invalid_file("{}: several calibrations ({} is another); keep only the right one", path,
                          found);
    }
    found = path;
  }
  return found;
}

// Gives the calibrated cameras the names and frames of the matching `cameras`, in their order.
Status match_cameras(const std::string& path, const std::vector<SourceCamera>& cameras,
                     const LogSink& log, Calibration& calibration) {
  const CameraNames names(cameras);
  std::vector<SourceCamera> matched(cameras.size());
  std::set<std::size_t> taken;
  for (const SourceCamera& calibrated : calibration.cameras) {
    STGS_ASSIGN(const std::size_t i, names.find(calibrated.name, path));
    if (i == cameras.size()) {
      log(2, fmt::format("{}: camera '{}' ignored (no frames)", path, calibrated.name));
      continue;
    }
    if (!taken.insert(i).second) {
      return invalid_file(
          "{}: two cameras match '{}'; rename the videos or image folders after the "
          "cameras of the calibration",
          path, cameras[i].name);
    }
    matched[i] = calibrated;
    matched[i].name = cameras[i].name;
    matched[i].video = cameras[i].video;
    matched[i].images = cameras[i].images;
    matched[i].numbered = cameras[i].numbered;
  }
  if (taken.size() < kMinCameras && taken.size() < cameras.size()) {
    return invalid_file(
        "{}: of its cameras ({}), {} matched to the videos or image folders ({}), but at least {} "
        "are needed; rename them after the cameras of the calibration",
        path, list_names(calibration.cameras), taken.empty() ? "none is" : "only 1 is",
        list_names(cameras), kMinCameras);
  }
  calibration.cameras.clear();
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (taken.count(i) != 0) {
      calibration.cameras.push_back(std::move(matched[i]));
    } else {
      log(1, fmt::format("{}: '{}' ignored (not in the calibration)", path, cameras[i].name));
    }
  }
  return {};
}

// Tools that have calibrated only the intrinsics write equal poses.
Status check_poses(const std::string& path, const std::vector<SourceCamera>& cameras) {
  const auto same_pose = [&](const SourceCamera& camera) {
    return std::equal(camera.rotation, camera.rotation + 9, cameras.front().rotation) &&
           std::equal(camera.translation, camera.translation + 3, cameras.front().translation);
  };
  if (cameras.size() < 2 || !std::all_of(cameras.begin(), cameras.end(), same_pose)) return {};
  return invalid_file(
      "{}: all cameras have the same pose; calibrate the extrinsics too, or remove the file to "
      "calibrate with COLMAP",
      path);
}

// Reads the files that are named after cameras. Files that are no calibration are ignored, but
// damaged ones only if no other file is a calibration.
Status read_opencv_cameras(const CaptureFolder& files, const std::vector<std::string>& paths,
                           const std::vector<SourceCamera>& cameras, CalibrationSearch& search) {
  Status damaged;
  const CameraNames names(cameras);
  std::map<std::string, std::string> path_of;  // by camera
  for (const std::string& path : paths) {
    const std::string stem = stem_of(path);
    if (!may_be_opencv(file_name(path)) || !names.any(stem)) continue;
    Result<Calibration> read = read_opencv_camera(files, path, stem);
    if (!read.ok() && damaged.ok()) damaged = read.status();
    if (!read.ok() || read->cameras.empty()) {
      search.ignored.push_back(path);
      continue;
    }
    STGS_ASSIGN(const std::size_t i, names.find(stem, path));
    const auto [it, added] = path_of.emplace(cameras[i].name, path);
    if (!added) {
      return invalid_file(
          "{}: another calibration of camera '{}' ({} is one); keep only the right "
          "one",
          path, cameras[i].name, it->second);
    }
    read->cameras.front().name = cameras[i].name;
    search.calibration.cameras.push_back(std::move(read->cameras.front()));
  }
  if (search.calibration.cameras.empty()) return {};
  search.path = files.path();
  return damaged;
}

// Reads the calibration of the most specific kind into `search`. Sets search.path if there is one.
Status read_calibration(const CaptureFolder& files, const std::vector<std::string>& paths,
                        const std::vector<SourceCamera>& cameras, const LogSink& log,
                        CalibrationSearch& search) {
  STGS_ASSIGN(search.path, only_one(files, paths, is_qualisys));
  if (!search.path.empty()) {
    STGS_ASSIGN(search.calibration, read_qualisys(files, search.path, log));
    return {};
  }
  STGS_ASSIGN(search.path, only_one(files, paths, is_toml_calibration));
  if (!search.path.empty()) {
    STGS_ASSIGN(search.calibration, read_toml_calibration(files, search.path));
    return {};
  }
  return read_opencv_cameras(files, paths, cameras, search);
}

}  // namespace

Result<CalibrationSearch> find_calibration(const CaptureFolder& files,
                                           const std::vector<SourceCamera>& cameras,
                                           const LogSink& log) {
  std::vector<std::string> paths;
  for (const char* below : {"", "/videos", "/images", "/calibration"}) {
    STGS_ASSIGN(const std::vector<std::string> found, list_files(files, files.path() + below));
    paths.insert(paths.end(), found.begin(), found.end());
  }
  CalibrationSearch search;
  STGS_TRY(read_calibration(files, paths, cameras, log, search));
  if (!search.path.empty()) {
    STGS_TRY(check_camera_limit(search.calibration.cameras.size(), search.path));
    STGS_TRY(match_cameras(search.path, cameras, log, search.calibration));
    STGS_TRY(check_poses(search.path, search.calibration.cameras));
    log(2, fmt::format("{}: calibration of {}", search.path,
                       plural(search.calibration.cameras.size(), "camera")));
    return search;
  }
  for (const std::string& path : paths) {
    if (suggests_calibration(file_name(path))) search.ignored.push_back(path);
  }
  std::sort(search.ignored.begin(), search.ignored.end());
  const auto end = std::unique(search.ignored.begin(), search.ignored.end());
  search.ignored.erase(end, search.ignored.end());
  for (const std::string& path : search.ignored) {
    log(1, path + ": ignored (not a calibration with poses in a known format)");
  }
  return search;
}

}  // namespace stgs::encoder
