// SPDX-License-Identifier: Apache-2.0
#include "os/regular_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "stgs/format/byte_source.h"
#include "stgs/format/text.h"

namespace stgs {

Status check_regular(int descriptor, const std::string& path) {
  struct stat status {};  // of no type if it cannot be read
  (void)::fstat(descriptor, &status);
  if (S_ISDIR(status.st_mode)) {
    return io_error("{}: this is a folder; name a file in it", path);
  }
  if (!S_ISREG(status.st_mode)) return io_error("{}: not a regular file", path);
  return {};
}

Result<int> os::open_regular(const std::string& path) {
  // O_NONBLOCK: opening a pipe would wait for a writer. It has no effect on files.
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (file < 0) return io_error("{}: cannot open: {}", path, file_problem(errno));
  const Status regular = check_regular(file, path);
  if (regular.ok()) return file;
  ::close(file);
  return regular;
}

}  // namespace stgs
