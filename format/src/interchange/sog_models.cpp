// SPDX-License-Identifier: Apache-2.0
#include "interchange/sog_models.h"

#include <algorithm>
#include <filesystem>

#include "os/folder.h"
#include "stgs/format/interchange_formats.h"

namespace stgs {

Result<std::vector<std::string>> sog_models(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_directory(path, error)) return std::vector<std::string>{path};
  if (fs::exists(fs::path(path) / "meta.json", error)) {
    return std::vector<std::string>{(fs::path(path) / "meta.json").string()};
  }
  if (fs::exists(fs::path(path) / "lod-meta.json", error)) {
    return unsupported(
        "{}: streamed SOG set with several levels of detail is not supported; use a folder with "
        "the "
        "chunks of one level",
        path);
  }
  std::vector<std::string> found;
  STGS_ASSIGN(const std::vector<std::string> names, os::list_folder(path));
  for (const std::string& name : names) {
    const fs::path entry = fs::path(path) / name, meta = entry / "meta.json";
    if (fs::is_regular_file(meta, error)) {
      found.push_back(meta.string());
    } else if (entry.extension() == ".sog" && fs::is_regular_file(entry, error)) {
      found.push_back(entry.string());
    }
  }
  if (found.empty()) return io_error("{}: no SOG model in the folder (meta.json not found)", path);
  std::sort(found.begin(), found.end());
  return found;
}

bool is_sog_folder(const std::string& folder) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error)) return false;
  return sog_models(folder).ok() ||
         std::filesystem::exists(std::filesystem::path(folder) / "lod-meta.json", error);
}

SogKind sog_kind_of_extension(const std::string& path) {
  const std::string extension = file_extension(path);
  if (extension == ".sogst") return SogKind::kSogst;
  return extension == ".tsog" ? SogKind::kTsog : SogKind::kSog;
}

}  // namespace stgs
