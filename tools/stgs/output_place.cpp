// SPDX-License-Identifier: Apache-2.0
#include "output_place.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <filesystem>

#include "session.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

Status check_parent(const std::string& path) {
  std::error_code error;
  fs::path parent = fs::path(path).parent_path();
  if (parent.empty()) parent = ".";
  const fs::file_status status = fs::status(parent, error);
  if (status.type() == fs::file_type::not_found) {
    return io_error("{}: cannot create: the folder '{}' does not exist", path, parent.string());
  }
  if (status.type() != fs::file_type::directory) {
    return io_error("{}: cannot create: '{}' is not a folder", path, parent.string());
  }
  return {};
}

// The name of a work folder, or of a temporary file, is a process id between these two.
struct NameParts {
  std::string before, after;
};
NameParts work_parts(const fs::path& path) {
  return {fmt::format(".{}.", path.filename().string()), ".tmp.work"};
}

}  // namespace

std::string work_name(const std::string& path) {
  const fs::path whole(path);
  const NameParts parts = work_parts(whole);
  return (whole.parent_path() / fmt::format("{}{}{}", parts.before, ::getpid(), parts.after))
      .string();
}

std::vector<std::string> remove_stale_work(const std::string& path) {
  const NameParts parts = work_parts(path);
  return remove_stale(path, parts.before, parts.after, fs::file_type::directory);
}

std::vector<std::string> remove_stale_files(const std::string& path) {
  const fs::path whole(path);
  const NameParts parts = {fmt::format(".{}.", whole.stem().string()),
                           fmt::format(".tmp{}", whole.extension().string())};
  return remove_stale(path, parts.before, parts.after, fs::file_type::regular);
}

Status check_can_write(const std::string& path) {
  STGS_TRY(check_parent(path));
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::directory) {
    return io_error("{}: cannot write: it is a folder; name a file", path);
  }
  if (fs::exists(status) && status.type() != fs::file_type::regular) {
    return io_error("{}: cannot write: it exists and is not a regular file", path);
  }
  const std::string probe = temporary_name(path);
  const int fd = ::open(probe.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0) return io_error("{}: cannot create: {}", path, system_message(errno));
  ::close(fd);
  ::unlink(probe.c_str());
  return {};
}

Status check_can_make_folder(const std::string& path) {
  std::string folder = path;
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  std::error_code error;
  const fs::file_status status = fs::status(folder, error);
  if (fs::exists(status) && status.type() != fs::file_type::directory) {
    return io_error("{}: cannot write: it exists and is not a folder", folder);
  }
  return check_can_write(fs::exists(status) ? folder + "/probe" : folder);
}

Status check_distinct(const std::vector<NamedPlace>& places) {
  const auto same = [](const std::string& a, const std::string& b) {
    std::error_code error;  // a path that cannot be looked at is told of where it is opened
    if (fs::equivalent(a, b, error)) return true;
    const fs::path x = fs::weakly_canonical(fs::absolute(a, error), error);
    return !error && x == fs::weakly_canonical(fs::absolute(b, error), error) && !error;
  };
  for (auto one = places.begin(); one != places.end(); ++one) {
    for (auto other = places.begin(); other != one; ++other) {
      if (one->path.empty() || other->path.empty() || !same(one->path, other->path)) continue;
      return usage_error("{}: is where both {} and {} lead; give each a place of its own",
                         one->path, other->option, one->option);
    }
  }
  return {};
}

RemovedPath::~RemovedPath() {
  std::error_code ignored;  // a destructor has nobody to tell; the path is a temporary
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace stgs::tools
