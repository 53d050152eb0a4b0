// SPDX-License-Identifier: Apache-2.0
#include "os/file_lock.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace stgs::os {
namespace {

constexpr int kMaxDepth = 64;  // of the folders that are deleted

// Deletes what is in a folder, except `spared` itself. Closes the descriptor.
void remove_contents(int folder, const char* spared, int depth) noexcept {
  DIR* const entries = ::fdopendir(folder);
  if (entries == nullptr) {
    ::close(folder);
    return;
  }
  while (const dirent* entry = ::readdir(entries)) {
    const char* name = entry->d_name;
    if (std::strcmp(name, ".") == 0 || std::strcmp(name, "..") == 0) continue;
    if (spared != nullptr && std::strcmp(name, spared) == 0) continue;
    if (::unlinkat(folder, name, 0) == 0 || errno != EISDIR) continue;
    const int inner = ::openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (inner >= 0 && depth < kMaxDepth) {
      remove_contents(inner, nullptr, depth + 1);
    } else if (inner >= 0) {
      ::close(inner);
    }
    ::unlinkat(folder, name, AT_REMOVEDIR);
  }
  ::closedir(entries);
}

}  // namespace

LockResult try_lock(int descriptor) {
  int result = 0;
  do {
    result = ::flock(descriptor, LOCK_EX | LOCK_NB);
  } while (result != 0 && errno == EINTR);
  if (result == 0) return LockResult::kTaken;
  return errno == EWOULDBLOCK ? LockResult::kBusy : LockResult::kUnavailable;
}

bool is_named(int descriptor, const std::string& path) {
  struct stat open {
  }, named{};
  return ::fstat(descriptor, &open) == 0 && ::lstat(path.c_str(), &named) == 0 &&
         open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

bool remove_folder(const std::string& path) noexcept {
  const int folder = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (folder < 0) return errno == ENOENT;
  const int again = ::fcntl(folder, F_DUPFD_CLOEXEC, 0);  // the first is closed with the entries
  remove_contents(folder, "lock", 0);
  if (again >= 0) {
    ::unlinkat(again, "lock", 0);
    ::close(again);
  }
  return ::rmdir(path.c_str()) == 0 || errno == ENOENT;
}

}  // namespace stgs::os
