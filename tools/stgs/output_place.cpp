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

// Whether `name` is before, a process id and after, and that process is no more. A process with
// our own id is: we ask before we make the folder.
bool is_stale(const std::string& name, const NameParts& parts) {
  if (name.size() <= parts.before.size() + parts.after.size()) return false;
  if (name.compare(0, parts.before.size(), parts.before) != 0) return false;
  const std::size_t end = name.size() - parts.after.size();
  if (name.compare(end, std::string::npos, parts.after) != 0) return false;
  pid_t pid = 0;
  const char* last = name.data() + end;
  const auto read = std::from_chars(name.data() + parts.before.size(), last, pid);
  if (read.ec != std::errc() || read.ptr != last || pid <= 0) return false;
  return pid == ::getpid() || (::kill(pid, 0) != 0 && errno == ESRCH);
}

std::vector<std::string> remove_stale(const fs::path& whole, const NameParts& parts,
                                      fs::file_type type) {
  const fs::path parent = whole.has_parent_path() ? whole.parent_path() : fs::path(".");
  std::vector<fs::path> stale;
  std::error_code error;
  for (fs::directory_iterator it(parent, error), end; !error && it != end; it.increment(error)) {
    std::error_code ignored;  // what cannot be looked at is not ours to remove
    const bool fits = it->symlink_status(ignored).type() == type;
    if (fits && is_stale(it->path().filename().string(), parts)) stale.push_back(it->path());
  }
  std::vector<std::string> removed;
  for (const fs::path& found : stale) {
    fs::remove_all(found, error);
    if (!error) removed.push_back(found.lexically_normal().string());
  }
  return removed;
}

}  // namespace

std::string work_name(const std::string& path) {
  const fs::path whole(path);
  const NameParts parts = work_parts(whole);
  return (whole.parent_path() / fmt::format("{}{}{}", parts.before, ::getpid(), parts.after))
      .string();
}

std::vector<std::string> remove_stale_work(const std::string& path) {
  return remove_stale(path, work_parts(path), fs::file_type::directory);
}

std::vector<std::string> remove_stale_files(const std::string& path) {
  const fs::path whole(path);
  const NameParts parts = {fmt::format(".{}.", whole.stem().string()),
                           fmt::format(".tmp{}", whole.extension().string())};
  return remove_stale(whole, parts, fs::file_type::regular);
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

RemovedPath::~RemovedPath() {
  std::error_code ignored;  // a destructor has nobody to tell; the path is a temporary
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace stgs::tools
