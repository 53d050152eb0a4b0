// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/output_file.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <filesystem>

#include "stgs/format/text.h"

namespace stgs {
namespace {

namespace fs = std::filesystem;

// Returns whether `name` is prefix, process id, suffix, and that process has ended. An entry with
// our own process id is stale too: this is called before our own is created.
bool is_stale(const std::string& name, const std::string& prefix, const std::string& suffix) {
  if (name.size() <= prefix.size() + suffix.size()) return false;
  if (name.compare(0, prefix.size(), prefix) != 0) return false;
  const std::size_t end = name.size() - suffix.size();
  if (name.compare(end, std::string::npos, suffix) != 0) return false;
  pid_t pid = 0;
  const char* last = name.data() + end;
  const auto read = std::from_chars(name.data() + prefix.size(), last, pid);
  if (read.ec != std::errc() || read.ptr != last || pid <= 0) return false;
  return pid == ::getpid() || (::kill(pid, 0) != 0 && errno == ESRCH);
}

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

// Returns whether the path still names the descriptor's file.
bool is_named(int fd, const std::string& path) {
  struct stat open {
  }, named{};
  return ::fstat(fd, &open) == 0 && ::stat(path.c_str(), &named) == 0 &&
         open.st_dev == named.st_dev && open.st_ino == named.st_ino;
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

std::string temporary_name(const std::string& path) {
  const std::filesystem::path full_path(path);
  const std::string name = fmt::format(".{}.{}.tmp{}", full_path.stem().string(), ::getpid(),
                                       full_path.extension().string());
  return (full_path.parent_path() / name).string();
}

std::vector<std::string> remove_stale(const std::string& path, const std::string& prefix,
                                      const std::string& suffix, fs::file_type type) {
  const fs::path full_path(path);
  const fs::path parent = full_path.has_parent_path() ? full_path.parent_path() : fs::path(".");
  std::vector<fs::path> stale;
  std::error_code error;
  for (fs::directory_iterator it(parent, error), end; !error && it != end; it.increment(error)) {
    std::error_code ignored;  // entries without a status are not ours
    const bool fits = it->symlink_status(ignored).type() == type;
    if (fits && is_stale(it->path().filename().string(), prefix, suffix))
      stale.push_back(it->path());
  }
  std::vector<std::string> removed;
  for (const fs::path& found : stale) {
    fs::remove_all(found, error);
    if (!error) removed.push_back(found.lexically_normal().string());
  }
  return removed;
}

Status rename_over(const std::string& from, const std::string& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) {
    return io_error("{}: cannot replace: {}", to, system_message(errno));
  }
  return {};
}

OutputFile::~OutputFile() {
  if (fd_ >= 0 && !borrowed_) ::close(fd_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

Status OutputFile::open(const std::string& path) {
  path_ = path;
  std::string target = path;
  struct stat info {};
  const bool exists = ::stat(path.c_str(), &info) == 0;
  if (exists && S_ISDIR(info.st_mode)) return io_error("{}: is a folder; name a file", path);
  if (!exists || S_ISREG(info.st_mode)) target = temporary_ = temporary_name(path);
  fd_ = ::open(target.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd_ < 0) {
    temporary_.clear();
    return io_error("{}: cannot create: {}", path, file_problem(errno));
  }
  return {};
}

void OutputFile::borrow(int descriptor, const std::string& name) {
  path_ = name;
  fd_ = descriptor;
  borrowed_ = true;
}

Status OutputFile::write(std::span<const std::uint8_t> bytes) {
  const int error = write_all(fd_, bytes);
  if (error != 0) return io_error("{}: cannot write: {}", path_, system_message(error));
  return {};
}

Status OutputFile::close() {
  const int fd = std::exchange(fd_, -1);
  // Devices and pipes cannot be synced.
  const bool synced = ::fsync(fd) == 0 || errno == EINVAL || errno == EROFS;
  const int sync_error = errno;
  if (::close(fd) != 0 && synced) {
    return io_error("{}: cannot write: {}", path_, system_message(errno));
  }
  if (!synced) return io_error("{}: cannot write: {}", path_, system_message(sync_error));
  return {};
}

Status OutputFile::commit() {
  if (borrowed_) return {};
  STGS_TRY(close());
  if (temporary_.empty()) return {};
  STGS_TRY(rename_over(temporary_, path_));
  temporary_.clear();
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
  if (unfinished_ && is_named(fd_, path_)) ::unlink(path_.c_str());
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
  if (!is_named(fd_, path)) return io_error("{}: replaced while being opened; try again", path);
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
