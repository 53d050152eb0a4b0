// SPDX-License-Identifier: Apache-2.0
#include "output_path.h"

#include <algorithm>
#include <filesystem>
#include <string_view>

#include "stgs/format/interchange_formats.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

std::string without_slashes(std::string folder) {
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  return folder;
}

struct KnownExtensions {
  const char* advice;  // completes the message
  std::vector<std::string_view> extensions;
};

// Extensions that promise another format than a verb writes.
const std::vector<KnownExtensions>& foreign_extensions() {
  static const std::vector<KnownExtensions> all = {
      {"'stgs render' writes video", {".mp4", ".y4m"}},
      {"'stgs render' writes images", {".png", ".exr"}},
      {"'stgs convert' writes other formats of Gaussian splats",
       {".ply", ".spz", ".glb", ".4dgs", ".usda"}},
      {"", {".mov",    ".mkv",  ".webm", ".avi",  ".m4v",  ".gif",   ".jpg",   ".jpeg",   ".webp",
            ".bmp",    ".tif",  ".tiff", ".gltf", ".sog",  ".sogst", ".tsog",  ".splatv", ".splat",
            ".ksplat", ".obj",  ".fbx",  ".usd",  ".usdz", ".json",  ".jsonl", ".html",   ".txt",
            ".csv",    ".ckpt", ".zip",  ".tar",  ".gz",   ".zst"}},
  };
  return all;
}

}  // namespace

Status check_extension(const std::string& path, const char* verb, const std::string& extension) {
  const std::string own = file_extension(without_slashes(path));
  if (extension.empty() && own == ".stgs") {
    return usage_error("{}: {} writes a folder, not a .stgs file; use another name", path, verb);
  }
  for (const KnownExtensions& known : foreign_extensions()) {
    if (std::find(known.extensions.begin(), known.extensions.end(), own) ==
        known.extensions.end()) {
      continue;
    }
    const std::string advice = *known.advice == '\0' ? "" : fmt::format(" ({})", known.advice);
    if (extension.empty()) {
      return usage_error("{}: {} writes a folder, not a {} file; use another name{}", path, verb,
                         own, advice);
    }
    return usage_error("{}: {} writes a {} file; use a name that ends in {}{}", path, verb,
                       extension, extension, advice);
  }
  return {};
}

Status check_can_make_folder(const std::string& path) {
  const std::string folder = without_slashes(path);
  std::error_code error;
  const fs::file_status status = fs::status(folder, error);
  if (fs::exists(status) && status.type() != fs::file_type::directory) {
    return io_error("{}: cannot write: it exists and is not a folder", folder);
  }
  return check_can_write(fs::exists(status) ? folder + "/probe" : folder);
}

bool is_in_new_folder(const std::string& path, const std::string& folder) {
  std::error_code error;
  if (folder.empty() || fs::status(folder, error).type() != fs::file_type::not_found) return false;
  const auto canonical = [&error](const std::string& name) {
    return fs::weakly_canonical(fs::absolute(without_slashes(name), error), error);
  };
  const fs::path inner = canonical(path), outer = canonical(folder);
  return !error && inner.parent_path() == outer;
}

}  // namespace stgs::tools
