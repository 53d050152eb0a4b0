// SPDX-License-Identifier: Apache-2.0
#include "standard_streams.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <vector>

#include "session.h"

namespace stgs::tools {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 20;     // bytes per read
constexpr std::size_t kMaxBytes = std::size_t{4} << 30;  // held in memory
// A pipe that is ready takes this many bytes without waiting.
constexpr std::size_t kPipeBlock = PIPE_BUF;

// Waits until a stream can be read or written without waiting, or has failed.
Status wait_for(int descriptor, short events, const char* name) {
  constexpr int kMilliseconds = 50;
  for (;;) {
    pollfd stream = {descriptor, events, 0};
    const int ready = ::poll(&stream, 1, kMilliseconds);
    if (ready > 0 || (ready < 0 && errno != EINTR)) return {};
    if (interrupted()) return runtime_error("{}: stopped while waiting for it", name);
  }
}

Status read_all(std::vector<std::uint8_t>& bytes) {
  for (;;) {
    STGS_TRY(wait_for(STDIN_FILENO, POLLIN, "standard input"));
    const std::size_t size = bytes.size();
    if (size > kMaxBytes) {
      return unsupported("standard input: more than {} bytes; name a file", kMaxBytes);
    }
    bytes.resize(size + kBlock);
    const ssize_t got = ::read(STDIN_FILENO, bytes.data() + size, kBlock);
    const bool is_repeated = got < 0 && (errno == EINTR || errno == EAGAIN);
    bytes.resize(size + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got < 0 && !is_repeated)
      return io_error("standard input: cannot read: {}", system_message(errno));
    if (got == 0) return {};
  }
}

}  // namespace

Result<std::span<const std::uint8_t>> read_standard_input() {
  static std::vector<std::uint8_t> bytes;
  static bool is_read = false;
  if (!is_read) {
    if (::isatty(STDIN_FILENO) != 0) {
      return usage_error("standard input is a terminal; redirect a file to it, or name a file");
    }
    STGS_TRY(read_all(bytes));
    is_read = true;
  }
  return std::span<const std::uint8_t>(bytes);
}

Status write_standard_output(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    STGS_TRY(wait_for(STDOUT_FILENO, POLLOUT, "standard output"));
    const std::size_t size = std::min(bytes.size(), kPipeBlock);
    const ssize_t written = ::write(STDOUT_FILENO, bytes.data(), size);
    if (written < 0 && errno != EINTR && errno != EAGAIN) {
      return io_error("standard output: cannot write: {}", system_message(errno));
    }
    bytes = bytes.subspan(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
  }
  return {};
}

}  // namespace stgs::tools
