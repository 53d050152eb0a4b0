// SPDX-License-Identifier: Apache-2.0
#include "output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
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

}  // namespace

std::string temporary_name(const std::string& path) {
  const fs::path whole(path);
  const std::string name =
      fmt::format(".{}.{}.tmp{}", whole.stem().string(), ::getpid(), whole.extension().string());
  return (whole.parent_path() / name).string();
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

OutputFile::~OutputFile() {
  if (fd_ >= 0 && !temporary_.empty()) {
    ::close(fd_);
    ::unlink(temporary_.c_str());
  }
}

Status OutputFile::open(const std::string& path) {
  path_ = path;
  if (path == "-") {
    path_ = "standard output";
    fd_ = STDOUT_FILENO;
    return {};
  }
  STGS_TRY(check_can_write(path));
  temporary_ = temporary_name(path);
  fd_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd_ < 0) return io_error("{}: cannot create: {}", path, system_message(errno));
  return {};
}

Status OutputFile::write(std::span<const std::uint8_t> bytes) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t wrote = ::write(fd_, bytes.data() + done, bytes.size() - done);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote < 0) return io_error("{}: cannot write: {}", path_, system_message(errno));
    done += static_cast<std::size_t>(wrote);
  }
  return {};
}

Status OutputFile::commit() {
  if (temporary_.empty()) return {};
  const int fd = fd_;
  fd_ = -1;
  const bool synced = ::fsync(fd) == 0;
  const int sync_error = errno;
  const bool closed = ::close(fd) == 0;
  Status status;
  if (!synced || !closed) {
    status = io_error("{}: cannot write: {}", path_, system_message(synced ? errno : sync_error));
  } else {
    status = rename_over(temporary_, path_);
  }
  if (!status.ok()) ::unlink(temporary_.c_str());
  return status;
}

RemovedPath::~RemovedPath() {
  std::error_code ignored;  // a destructor has nobody to tell; the path is a temporary
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

Status rename_over(const std::string& from, const std::string& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) {
    return io_error("{}: cannot replace: {}", to, system_message(errno));
  }
  return {};
}

}  // namespace stgs::tools
