// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/output_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "os/file_lock.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

namespace fs = std::filesystem;

// Returns 0 or an errno.
int write_all(int fd, std::span<const std::uint8_t> bytes) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t wrote = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote < 0) return errno;
    done += static_cast<std::size_t>(wrote);
  }
  return 0;
}

// Syncs the folder of `path`, so that the file's name is on disk.
Status sync_folder(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  const int fd = ::open(parent.empty() ? "." : parent.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // EACCES: the folder is not readable. EINVAL: it cannot be synced.
  const bool synced = fd < 0 ? errno == EACCES : ::fsync(fd) == 0 || errno == EINVAL;
  const int error = errno;
  if (fd >= 0) ::close(fd);
  if (!synced) return io_error("{}: cannot sync the folder: {}", path, system_message(error));
  return {};
}

}  // namespace

Status rename_over(const std::string& from, const std::string& to) {
  const int file = ::open(from.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  const Status kept = file < 0 ? Status() : keep_mode(file, to);
  if (file >= 0) ::close(file);
  STGS_TRY(kept);
  if (std::rename(from.c_str(), to.c_str()) != 0) {
    return io_error("{}: cannot replace: {}", to, system_message(errno));
  }
  return {};
}

OutputFile::~OutputFile() {
  if (device_ >= 0) ::close(device_);
}

Status OutputFile::open(const std::string& path) {
  path_ = path;
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || S_ISREG(info.st_mode)) return temporary_.create(path);
  if (S_ISDIR(info.st_mode)) return io_error("{}: is a folder; name a file", path);
  if (!S_ISCHR(info.st_mode) && !S_ISFIFO(info.st_mode)) {
    return io_error("{}: is a disk or a socket; name a file", path);
  }
  device_ = ::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  if (device_ < 0) return io_error("{}: cannot create: {}", path, file_problem(errno));
  return {};
}

Status OutputFile::write(std::span<const std::uint8_t> bytes) {
  const int error = write_all(descriptor(), bytes);
  if (error != 0) return io_error("{}: cannot write: {}", path_, system_message(error));
  return {};
}

Status OutputFile::sync() {
  // Devices and pipes cannot be synced.
  if (::fsync(descriptor()) != 0 && errno != EINVAL && errno != EROFS) {
    return io_error("{}: cannot write: {}", path_, system_message(errno));
  }
  return {};
}

Status OutputFile::publish() {
  STGS_TRY(sync());
  if (device_ >= 0) return {};
  if (::fcntl(descriptor(), F_SETFL, O_APPEND) != 0) {
    return io_error("{}: cannot append: {}", path_, system_message(errno));
  }
  return temporary_.publish();
}

Status OutputFile::commit() {
  STGS_TRY(sync());
  if (device_ < 0) return temporary_.commit();
  if (::close(std::exchange(device_, -1)) != 0) {
    return io_error("{}: cannot write: {}", path_, system_message(errno));
  }
  return {};
}

Status write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes) {
  OutputFile file;
  STGS_TRY(file.open(path));
  STGS_TRY(file.write(bytes));
  return file.commit();
}

AppendedFile::~AppendedFile() {
  release();
}

void AppendedFile::release() {
  if (fd_ < 0) return;
  // Unlinks while the lock is held, so that nobody resumes the file.
  if (unfinished_ && os::is_named(fd_, path_)) ::unlink(path_.c_str());
  unfinished_ = false;
  ::close(std::exchange(fd_, -1));
}

Status AppendedFile::lock() {
  if (::flock(fd_, LOCK_EX | LOCK_NB) == 0) return {};
  if (errno == EWOULDBLOCK) return usage_error("{}: in use by another recorder", path_);
  return io_error("{}: cannot lock: {}", path_, system_message(errno));
}

Status AppendedFile::create(const std::string& path, std::span<const std::uint8_t> bytes,
                            bool sync) {
  path_ = path;
  fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0666);
  if (fd_ < 0) return io_error("{}: cannot create: {}", path, file_problem(errno));
  unfinished_ = true;
  Status status = lock();
  if (status.ok()) status = append(bytes, sync);
  if (status.ok() && sync) status = sync_folder(path);
  if (!status.ok()) release();
  unfinished_ = false;
  return status;
}

Status AppendedFile::open(const std::string& path) {
  path_ = path;
  // O_NONBLOCK: do not block on a pipe, which source() rejects.
  fd_ = ::open(path.c_str(), O_RDWR | O_APPEND | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (fd_ < 0) return io_error("{}: cannot open for appending: {}", path, file_problem(errno));
  STGS_TRY(lock());
  if (!os::is_named(fd_, path)) return io_error("{}: replaced while being opened; try again", path);
  return {};
}

Result<std::unique_ptr<ByteSource>> AppendedFile::source() const {
  const int copy = ::fcntl(fd_, F_DUPFD_CLOEXEC, 0);
  if (copy < 0) return io_error("{}: cannot open: {}", path_, system_message(errno));
  return descriptor_source(copy, path_);
}

Status AppendedFile::cut(std::uint64_t bytes) {
  if (::ftruncate(fd_, static_cast<off_t>(bytes)) != 0) {
    return io_error("{}: cannot truncate to {} bytes: {}", path_, bytes, system_message(errno));
  }
  bytes_ = bytes;
  return {};
}

Status AppendedFile::append(std::span<const std::uint8_t> bytes, bool sync) {
  int error = write_all(fd_, bytes);
  if (error == 0 && sync && ::fdatasync(fd_) != 0) error = errno;
  if (error != 0) {
    // If truncating fails, readers skip the incomplete bytes.
    [[maybe_unused]] const int ignored = ::ftruncate(fd_, static_cast<off_t>(bytes_));
    release();
    return io_error("{}: cannot write: {}", path_, system_message(error));
  }
  bytes_ += bytes.size();
  return {};
}

Status AppendedFile::close() {
  if (fd_ < 0 || ::close(std::exchange(fd_, -1)) == 0) return {};
  return io_error("{}: cannot write: {}", path_, system_message(errno));
}

}  // namespace stgs
