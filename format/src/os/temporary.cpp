// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/temporary.h"

#include <fcntl.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <string_view>
#include <utility>

#include "os/file_lock.h"
#include "os/folder.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

namespace fs = std::filesystem;

// The listed objects.
Unfinished* first_unfinished = nullptr;

constexpr int kMaxAttempts = 16;  // names tried
constexpr std::string_view kDigits = "abcdefghijklmnopqrstuvwxyz234567";
constexpr std::size_t kRandomDigits = 12;  // 60 bits

// The name of a temporary is random between these two parts.
struct NameParts {
  std::string before, after;

  std::string name(const std::string& random) const { return before + random + after; }
  bool fits(std::string_view name) const {
    if (name.size() != before.size() + kRandomDigits + after.size()) return false;
    const std::string_view random = name.substr(before.size(), kRandomDigits);
    return name.starts_with(before) && name.ends_with(after) &&
           random.find_first_not_of(kDigits) == std::string_view::npos;
  }
};

NameParts file_parts(const fs::path& path) {
  return {fmt::format(".{}.", path.stem().string()),
          fmt::format(".tmp{}", path.extension().string())};
}

NameParts folder_parts(const fs::path& path) {
  return {fmt::format(".{}.", path.filename().string()), ".tmp.work"};
}

Result<std::string> random_digits(const std::string& path) {
  std::array<std::uint8_t, kRandomDigits> bytes{};
  ssize_t got = 0;
  do {
    got = ::getrandom(bytes.data(), bytes.size(), 0);
  } while (got < 0 && errno == EINTR);
  if (got != static_cast<ssize_t>(bytes.size())) {
    return io_error("{}: cannot create: no random name: {}", path, system_message(errno));
  }
  std::string digits;
  for (const std::uint8_t byte : bytes) digits += kDigits[byte % kDigits.size()];
  return digits;
}

Result<std::string> unique_name(const std::string& path, const NameParts& parts) {
  STGS_ASSIGN(const std::string random, random_digits(path));
  return (fs::path(path).parent_path() / parts.name(random)).string();
}

Status no_name(const std::string& path) {
  return io_error("{}: cannot create a temporary file; try again", path);
}

// Removes a file that no process uses.
bool remove_free_file(const std::string& name) {
  const int file = ::open(name.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (file < 0) return false;
  const bool removed = os::try_lock(file) == os::LockResult::kTaken && os::is_named(file, name) &&
                       ::unlink(name.c_str()) == 0;
  ::close(file);
  return removed;
}

// Returns whether a file is regular and empty, as locks are.
bool is_empty_file(int file) {
  struct stat status {};
  return ::fstat(file, &status) == 0 && S_ISREG(status.st_mode) && status.st_size == 0;
}

// Returns whether a file is a lock of this user, as WorkFolder::create() makes them.
bool is_own_lock(int file) {
  struct stat status {};
  return is_empty_file(file) && ::fstat(file, &status) == 0 && status.st_uid == ::geteuid();
}

// Anybody who may write to the folder of an output can hold its lock.
Status busy_error(const std::string& path, const std::string& name, int lock) {
  struct stat status {};
  if (::fstat(lock, &status) == 0 && status.st_uid != ::geteuid()) {
    return usage_error(
        "{}: a process has locked {}, a file of user {}; wait for it, or name an output in a "
        "folder "
        "that only you can write to",
        path, name, status.st_uid);
  }
  return usage_error("{}: another process is writing it; wait for it, or name another output",
                     path);
}

// Removes a folder of WorkFolder that no process uses. Others can rename any folder to such a name,
// so that one without a lock is removed only if it is empty: created just now, after which
// WorkFolder::create() tries another name, or by a process that was killed.
bool remove_free_folder(const std::string& name) {
  const std::string lock = name + "/lock";
  const int folder = ::open(name.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (folder < 0) return false;
  const int file = ::openat(folder, "lock", O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  const int error = errno;
  ::close(folder);
  if (file < 0) return error == ENOENT && ::rmdir(name.c_str()) == 0;
  const bool removed = is_own_lock(file) && os::try_lock(file) == os::LockResult::kTaken &&
                       os::is_named(file, lock) && os::remove_folder(name);
  ::close(file);
  return removed;
}

}  // namespace

std::mutex& Unfinished::list_mutex() noexcept {
  // Never destroyed: objects of static storage may outlive it.
  static std::mutex& mutex = *new std::mutex;
  return mutex;
}

void Unfinished::list(const ListLock&) noexcept {
  before_ = nullptr;
  after_ = std::exchange(first_unfinished, this);
  if (after_ != nullptr) after_->before_ = this;
  is_listed_ = true;
}

void Unfinished::unlist(const ListLock&) noexcept {
  if (!std::exchange(is_listed_, false)) return;
  (before_ != nullptr ? before_->after_ : first_unfinished) = after_;
  if (after_ != nullptr) after_->before_ = before_;
}

void remove_unfinished() noexcept {
  Unfinished::list_mutex().lock();  // for the rest of the process
  for (Unfinished* one = first_unfinished; one != nullptr; one = one->after_) one->abandon();
}

Status keep_mode(int descriptor, const std::string& path) {
  constexpr mode_t kPermissions = 0777;
  struct stat made {
  }, replaced{};
  if (::lstat(path.c_str(), &replaced) != 0 || !S_ISREG(replaced.st_mode)) return {};
  const mode_t mode = replaced.st_mode & kPermissions;
  const bool is_ours = ::fstat(descriptor, &made) == 0 && made.st_uid == replaced.st_uid;
  if (!is_ours || (made.st_mode & kPermissions) == mode) return {};
  if (::fchmod(descriptor, mode) == 0) return {};
  return io_error("{}: cannot keep the permissions of the file: {}", path, system_message(errno));
}

Status TemporaryFile::create(const std::string& path) {
  path_ = path;
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    STGS_ASSIGN(std::string name, unique_name(path, file_parts(path)));
    const ListLock lock(list_mutex());
    const int file = ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (file < 0 && errno == EEXIST) continue;
    if (file < 0) return io_error("{}: cannot create: {}", path, file_problem(errno));
    // Before the lock is taken, remove_leftovers() of another process may have removed the file.
    if (os::try_lock(file) != os::LockResult::kBusy && os::is_named(file, name)) {
      name_ = std::move(name);
      descriptor_ = file;
      list(lock);
      return keep_mode(file, path);
    }
    ::close(file);
  }
  return no_name(path);
}

Status TemporaryFile::publish() {
  const ListLock lock(list_mutex());
  if (std::rename(name_.c_str(), path_.c_str()) != 0) {
    return io_error("{}: cannot replace: {}", path_, system_message(errno));
  }
  unlist(lock);
  name_.clear();
  return {};
}

Status TemporaryFile::commit() {
  // Renamed before it is closed: without the lock it would look like a leftover.
  STGS_TRY(publish());
  if (::close(std::exchange(descriptor_, -1)) != 0) {
    return io_error("{}: cannot write: {}", path_, system_message(errno));
  }
  return {};
}

void TemporaryFile::remove() noexcept {
  const ListLock lock(list_mutex());
  abandon();
  unlist(lock);
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
}

void TemporaryFile::abandon() noexcept {
  if (!name_.empty() && os::is_named(descriptor_, name_)) ::unlink(name_.c_str());
}

Status WorkFolder::create(const std::string& path) {
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    STGS_ASSIGN(std::string name, unique_name(path, folder_parts(path)));
    std::string lock_name = name + "/lock";
    const ListLock lock(list_mutex());
    if (::mkdir(name.c_str(), 0700) != 0) {
      if (errno == EEXIST) continue;
      return io_error("{}: cannot create: {}", path, file_problem(errno));
    }
    const int file =
        ::open(lock_name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    const int error = errno;
    if (file >= 0 && os::try_lock(file) != os::LockResult::kBusy && os::is_named(file, lock_name)) {
      path_ = std::move(name);
      lock_name_ = std::move(lock_name);
      lock_ = file;
      list(lock);
      return {};
    }
    if (file >= 0) {
      ::close(file);
    } else if (error != EEXIST && error != ENOENT) {  // those: removed as a leftover meanwhile
      ::rmdir(name.c_str());
      return io_error("{}: cannot create: {}", path, file_problem(error));
    }
  }
  return no_name(path);
}

WorkFolder::~WorkFolder() {
  if (lock_ < 0) return;
  abandon();
  const ListLock lock(list_mutex());
  unlist(lock);
  ::close(lock_);
}

void WorkFolder::abandon() noexcept {
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {  // other threads may still write to it
    if (os::remove_folder(path_)) return;
  }
  ::unlink(lock_name_.c_str());  // no descriptor was left to list it
  ::rmdir(path_.c_str());
}

Status OutputLock::take(const std::string& path) {
  fs::path full = (fs::path(path) / "").parent_path();  // without a slash at the end
  std::error_code error;
  if (fs::is_directory(full, error)) {  // which has one lock, whatever link or dots lead to it
    const fs::path canonical = fs::canonical(full, error);
    if (!error) full = canonical;
  }
  std::string name =
      (full.parent_path() / fmt::format(".{}.lock", full.filename().string())).string();
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    const ListLock lock(list_mutex());
    const int file = ::open(
        name.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC, 0666);
    if (file < 0)
      return io_error("{}: cannot create: lock {}: {}", path, name, file_problem(errno));
    const os::LockResult result = os::try_lock(file);
    if (result == os::LockResult::kBusy) {
      const Status busy = busy_error(path, name, file);
      ::close(file);
      return busy;
    }
    if (!is_empty_file(file)) {
      ::close(file);
      return usage_error(
          "{}: {} is not a lock (expected an empty file); move it away, or name another output",
          path, name);
    }
    if (os::is_named(file, name)) {
      name_ = std::move(name);
      lock_ = file;
      list(lock);
      return {};
    }
    ::close(file);  // its last owner removed it meanwhile
  }
  return no_name(path);
}

OutputLock::~OutputLock() {
  if (lock_ < 0) return;
  const ListLock lock(list_mutex());  // its name is not random: another process may take it next
  abandon();
  unlist(lock);
  ::close(lock_);
}

void OutputLock::abandon() noexcept {
  if (os::is_named(lock_, name_)) ::unlink(name_.c_str());
}

std::vector<std::string> remove_leftovers(const std::string& path) {
  const fs::path full_path(path);
  const fs::path parent = full_path.has_parent_path() ? full_path.parent_path() : fs::path(".");
  const NameParts file = file_parts(full_path), folder = folder_parts(full_path);
  std::vector<std::string> removed;
  const Result<std::vector<std::string>> names = os::list_folder(parent.string());
  if (!names.ok()) return removed;
  for (const std::string& name : names.value()) {
    if (!file.fits(name) && !folder.fits(name)) continue;
    const std::string entry = (parent / name).lexically_normal().string();
    struct stat status {};
    if (::lstat(entry.c_str(), &status) != 0) continue;
    const bool gone = S_ISREG(status.st_mode)   ? remove_free_file(entry)
                      : S_ISDIR(status.st_mode) ? remove_free_folder(entry)
                                                : false;
    if (gone) removed.push_back(entry);
  }
  return removed;
}

}  // namespace stgs
