// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/output_path.h"

#include <filesystem>

namespace stgs {
namespace {

namespace fs = std::filesystem;

Status check_parent(const std::string& path) {
  std::error_code error;
  fs::path parent = fs::path(path).parent_path();
  if (parent.empty()) parent = ".";
  const fs::file_status status = fs::status(parent, error);
  if (status.type() == fs::file_type::not_found) {
    return io_error("{}: cannot create: folder '{}' does not exist; create it", path,
                    parent.string());
  }
  if (status.type() != fs::file_type::directory) {
    return io_error("{}: cannot create: '{}' is not a folder; choose another path", path,
                    parent.string());
  }
  return {};
}

}  // namespace

Status check_can_write(const std::string& path) {
  STGS_TRY(check_parent(path));
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::directory) {
    return io_error("{}: is a folder; name a file", path);
  }
  if (fs::exists(status) && status.type() != fs::file_type::regular) {
    return io_error("{}: exists and is not a regular file; name another path", path);
  }
  TemporaryFile probe;
  return probe.create(path);
}

void clear_leftovers(const std::string& path,
                     const std::function<void(int, const std::string&)>& log) {
  for (const std::string& name : remove_leftovers(path)) {
    if (log) log(2, fmt::format("{}: removed; left over from a run that was killed", name));
  }
}

Status prepare_output(const std::string& path, OutputLock& lock,
                      const std::function<void(int, const std::string&)>& log) {
  STGS_TRY(check_can_write(path));
  STGS_TRY(lock.take(path));
  clear_leftovers(path, log);
  return {};
}

Status check_distinct(const std::vector<NamedPath>& paths) {
  const auto same = [](const std::string& a, const std::string& b) {
    std::error_code error;  // ignored: opening the path reports it
    if (fs::equivalent(a, b, error)) return true;
    const fs::path x = fs::weakly_canonical(fs::absolute(a, error), error);
    return !error && x == fs::weakly_canonical(fs::absolute(b, error), error) && !error;
  };
  for (auto one = paths.begin(); one != paths.end(); ++one) {
    for (auto other = paths.begin(); other != one; ++other) {
      if (one->path.empty() || other->path.empty() || !same(one->path, other->path)) continue;
      return usage_error("{}: used by both {} and {}; choose different paths", one->path,
                         other->option, one->option);
    }
  }
  return {};
}

}  // namespace stgs
