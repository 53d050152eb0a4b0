// SPDX-License-Identifier: Apache-2.0
#include "output_path.h"

#include <unistd.h>

#include <filesystem>

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

std::string without_slashes(std::string folder) {
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  return folder;
}

// A work folder is named by a process id between these two parts.
struct NameParts {
  std::string before, after;
};
NameParts work_parts(const fs::path& path) {
  return {fmt::format(".{}.", path.filename().string()), ".tmp.work"};
}

}  // namespace

std::string work_name(const std::string& path) {
  const fs::path full(path);
  const NameParts parts = work_parts(full);
  return (full.parent_path() / fmt::format("{}{}{}", parts.before, ::getpid(), parts.after))
      .string();
}

std::vector<std::string> remove_stale_work(const std::string& path) {
  const NameParts parts = work_parts(path);
  return remove_stale(path, parts.before, parts.after, fs::file_type::directory);
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

RemovedPath::~RemovedPath() {
  std::error_code ignored;  // a temporary that stays behind is not worth an error
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace stgs::tools
