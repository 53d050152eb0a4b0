// SPDX-License-Identifier: Apache-2.0
#include "capture_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>

#include "frame_numbers.h"
#include "json_error.h"
#include "natural_order.h"
#include "plural.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

bool has_extension(const std::string& path, std::initializer_list<const char*> extensions) {
  std::string extension = fs::path(path).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::any_of(extensions.begin(), extensions.end(),
                     [&](const char* e) { return extension == e; });
}

// Lists the entries of kind `kind`, and those outside, whose names `accept` accepts.
template <typename Predicate>
Result<std::vector<std::string>> list(const CaptureFolder& files, const std::string& folder,
                                      CaptureFolder::Kind kind, Predicate accept) {
  STGS_ASSIGN(const auto entries, files.list(folder));
  std::vector<std::string> paths;
  for (const CaptureFolder::Entry& entry : *entries) {
    if (entry.kind != kind && entry.kind != CaptureFolder::Kind::kOutside) continue;
    if (accept(entry.name)) paths.push_back(folder + "/" + entry.name);
  }
  std::sort(paths.begin(), paths.end(), natural_less);
  return paths;
}

bool any_name(const std::string&) {
  return true;
}

// Returns whether a file name is `stem` and an extension. Faster than stem_of().
bool has_stem(const std::string& name, const std::string& stem) {
  return name.size() > stem.size() && name[stem.size()] == '.' &&
         name.compare(0, stem.size(), stem) == 0 && name.find('.', stem.size() + 1) == name.npos;
}

}  // namespace

bool is_video(const std::string& path) {
  return has_extension(path, {".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v"});
}

bool is_image(const std::string& path) {
  return has_extension(path, {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"});
}

Result<std::vector<std::string>> list_videos(const CaptureFolder& files,
                                             const std::string& folder) {
  return list(files, folder, CaptureFolder::Kind::kFile, is_video);
}

Result<std::vector<std::string>> list_images(const CaptureFolder& files,
                                             const std::string& folder) {
  return list(files, folder, CaptureFolder::Kind::kFile, is_image);
}

Result<std::vector<std::string>> list_folders(const CaptureFolder& files,
                                              const std::string& folder) {
  return list(files, folder, CaptureFolder::Kind::kFolder, any_name);
}

Result<std::vector<std::string>> list_files(const CaptureFolder& files, const std::string& folder) {
  return list(files, folder, CaptureFolder::Kind::kFile, any_name);
}

std::string stem_of(const std::string& path) {
  return fs::path(path).stem().string();
}

Result<bool> find_frames(const CaptureFolder& files, const std::string& folder,
                         const std::string& name, SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<std::string> videos,
              list(files, folder, CaptureFolder::Kind::kFile, [&](const std::string& file) {
                return has_stem(file, name) && is_video(file);
              }));
  if (!videos.empty()) {
    camera.video = videos.front();
    return true;
  }
  STGS_ASSIGN(camera.images, list_images(files, folder + "/" + name));
  if (camera.images.empty()) {
    STGS_ASSIGN(camera.images, list_images(files, folder + "/" + name + "/images"));
  }
  camera.numbered = !camera.images.empty();
  STGS_TRY(check_frame_limit(camera.images.size(), folder + "/" + name));
  return !camera.images.empty();
}

Result<std::vector<SourceCamera>> find_cameras(const CaptureFolder& files) {
  std::vector<SourceCamera> cameras;
  for (const char* below : {"/videos", "/images", ""}) {
    const std::string folder = files.path() + below;
    STGS_ASSIGN(const std::vector<std::string> videos, list_videos(files, folder));
    STGS_TRY(check_camera_limit(videos.size(), folder));
    for (const std::string& path : videos) {
      cameras.emplace_back().name = stem_of(path);
      cameras.back().video = path;
    }
    if (!cameras.empty()) return cameras;
    STGS_ASSIGN(const std::vector<std::string> folders, list_folders(files, folder));
    for (const std::string& path : folders) {
      SourceCamera camera;
      camera.name = fs::path(path).filename().string();
      const bool reserved = camera.name == "masks" || camera.name == "flow" ||
                            camera.name == "images" || camera.name == "calibration";
      if (reserved) continue;
      STGS_ASSIGN(const bool found, find_frames(files, folder, camera.name, camera));
      if (found) cameras.push_back(std::move(camera));
      STGS_TRY(check_camera_limit(cameras.size(), folder));
    }
    if (!cameras.empty()) return cameras;
  }
  return cameras;
}

Result<bool> find_masks(const CaptureFolder& files, const std::string& folder,
                        const std::string& name, SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<std::string> found, list_images(files, folder + "/" + name));
  if (found.empty()) return false;
  camera.masks.clear();
  if (camera.images.empty()) {
    camera.masks = found;
    STGS_TRY(check_mask_numbers(camera));
    return true;
  }
  std::map<std::string, std::string> by_stem;
  for (const std::string& path : found) by_stem.emplace(stem_of(path), path);
  for (std::size_t frame = 0; frame < camera.images.size(); ++frame) {
    const std::string stem = stem_of(camera.images[frame]);
    const auto it = by_stem.find(stem);
    if (it == by_stem.end()) {
      return io_error(
          "{}/{}: no mask for camera '{}' frame {} (expected {}.png); add it, or remove the folder "
          "to have masks computed",
          folder, name, camera.name, frame, stem);
    }
    camera.masks.push_back(it->second);
  }
  return true;
}

Status replace_folder(const std::string& made, const std::string& folder, bool overwrite) {
  if (::rename(made.c_str(), folder.c_str()) == 0) return {};  // there is none, or it is empty
  int error = errno;
  const bool exists = error == ENOTEMPTY || error == EEXIST || error == ENOTDIR;
  if (exists && !overwrite) {
    return io_error("{}: cannot move the result here: created by another program meanwhile",
                    folder);
  }
  // Exchanged, so that `folder` is complete at any time.
  const std::string old = made + ".old";
  if (exists &&
      ::renameat2(AT_FDCWD, made.c_str(), AT_FDCWD, folder.c_str(), RENAME_EXCHANGE) == 0) {
    return {};
  }
  if (exists && ::rename(folder.c_str(), old.c_str()) == 0) {  // not all file systems exchange
    if (::rename(made.c_str(), folder.c_str()) == 0) return {};
    error = errno;
    ::rename(old.c_str(), folder.c_str());
  }
  return io_error("{}: cannot move the result here: {}", folder, system_message(error));
}

Result<std::vector<std::uint8_t>> read_table(const CaptureFolder& files, const std::string& path) {
  return files.read(path, kCaptureLimits.table_bytes);
}

Result<nlohmann::json> read_json(const CaptureFolder& files, const std::string& path) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_table(files, path));
  return parse_json_text({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path);
}

Result<std::vector<double>> json_numbers(const nlohmann::json& json, const std::string& what) {
  std::vector<double> numbers;
  if (!json.is_array())
    return invalid_file("{}: expected a list of numbers, got {}", what, json.type_name());
  std::vector<const nlohmann::json*> stack = {&json};
  while (!stack.empty()) {
    const nlohmann::json& top = *stack.back();
    stack.pop_back();
    if (top.is_array()) {
      for (auto it = top.rbegin(); it != top.rend(); ++it) stack.push_back(&*it);
    } else if (top.is_number() && std::isfinite(top.get<double>())) {
      numbers.push_back(top.get<double>());
    } else {
      return invalid_file("{}: expected finite numbers, got {}", what, short_json(top));
    }
  }
  return numbers;
}

Status set_intrinsics(const std::vector<double>& k, double pixel_centre, const std::string& where,
                      SourceCamera& camera) {
  if (k.size() != 9)
    return invalid_file("{}: K has {} (expected 3x3)", where, plural(k.size(), "number"));
  if (!std::all_of(k.begin(), k.end(), [](double v) { return std::isfinite(v); })) {
    return invalid_file("{}: K has a number that is not finite", where);
  }
  const bool pinhole = k[0] > 0 && k[4] > 0 && std::abs(k[1]) <= 1e-4 * k[0] && k[3] == 0 &&
                       k[6] == 0 && k[7] == 0 && std::abs(k[8] - 1) < 1e-9;
  if (!pinhole) {
    return unsupported(
        "{}: K must be [fx 0 cx; 0 fy cy; 0 0 1] with positive focal lengths and no skew", where);
  }
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2] + 0.5 - pixel_centre;
  camera.cy = k[5] + 0.5 - pixel_centre;
  return {};
}

Status set_pose(const std::vector<double>& w2c, const std::string& where, SourceCamera& camera) {
  if (w2c.size() != 12 && w2c.size() != 16) {
    return invalid_file("{}: the pose has {} (expected 3x4 or 4x4)", where,
                        plural(w2c.size(), "number"));
  }
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      camera.rotation[3 * row + column] = w2c[4 * row + column];
    }
    camera.translation[row] = w2c[4 * row + 3];
  }
  return {};
}

Status set_pose_from_camera_to_world(const std::vector<double>& c2w, const std::string& where,
                                     SourceCamera& camera) {
  if (c2w.size() != 12 && c2w.size() != 16) {
    return invalid_file("{}: the pose has {} (expected 3x4 or 4x4)", where,
                        plural(c2w.size(), "number"));
  }
  for (int row = 0; row < 3; ++row) {
    camera.translation[row] = 0;
    for (int column = 0; column < 3; ++column) {
      camera.rotation[3 * row + column] = c2w[4 * column + row];
      camera.translation[row] -= c2w[4 * column + row] * c2w[4 * column + 3];
    }
  }
  return {};
}

Status set_size(double width, double height, const std::string& where, SourceCamera& camera) {
  if (!(width >= 1 && height >= 1 && width <= kMaxImageSide && height <= kMaxImageSide)) {
    return invalid_file("{}: invalid image size {}x{} (expected 1 to {} pixels)", where, width,
                        height, kMaxImageSide);
  }
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  return {};
}

Status set_distortion(std::vector<double> coefficients, bool fisheye, const std::string& where,
                      SourceCamera& camera) {
  if (!std::all_of(coefficients.begin(), coefficients.end(),
                   [](double v) { return std::isfinite(v); })) {
    return invalid_file("{}: a coefficient of the lens distortion is not finite", where);
  }
  const bool none =
      std::all_of(coefficients.begin(), coefficients.end(), [](double v) { return v == 0; });
  if (none && !fisheye) return {};
  if (fisheye) {
    if (coefficients.size() != 4) {
      return invalid_file("{}: fisheye lens with {} (expected 4: k1 k2 k3 k4)", where,
                          plural(coefficients.size(), "coefficient"));
    }
    camera.lens = LensModel::kFisheye;
  } else {
    if (coefficients.size() != 4 && coefficients.size() != 5 && coefficients.size() != 8) {
      return invalid_file(
          "{}: lens distortion with {} (expected 4, 5 or 8: k1 k2 p1 p2 [k3 [k4 k5 k6]])", where,
          plural(coefficients.size(), "coefficient"));
    }
    camera.lens = LensModel::kOpenCv;
  }
  camera.distortion = std::move(coefficients);
  return {};
}

}  // namespace stgs::encoder
