// SPDX-License-Identifier: Apache-2.0
#include "standard_streams.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <new>
#include <optional>

#include "session.h"

namespace stgs::tools {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 20;  // bytes per read
// A pipe that is ready takes this many bytes without waiting.
constexpr std::size_t kPipeBlock = PIPE_BUF;

// Waits until a stream can be read or written without waiting, or has failed.
// Where write_standard_error() writes.
std::atomic<int> standard_error{STDERR_FILENO};

Status wait_for(int descriptor, short events, const char* name) {
  constexpr int kMilliseconds = 50;
  for (;;) {
    pollfd stream = {descriptor, events, 0};
    const int ready = ::poll(&stream, 1, kMilliseconds);
    if (ready > 0 || (ready < 0 && errno != EINTR)) return {};
    if (interrupted()) return runtime_error("{}: stopped while waiting for it", name);
  }
}

// Waits until standard error takes bytes. After SIGINT or SIGTERM it waits for a short time, once:
// what nobody reads is lost.
bool wait_for_standard_error() {
  constexpr int kMilliseconds = 50, kLast = 300;
  static std::atomic<bool> given_up = false;
  for (;;) {
    const bool last = interrupted();
    pollfd stream = {standard_error, POLLOUT, 0};
    const int ready = ::poll(&stream, 1, !last ? kMilliseconds : given_up ? 0 : kLast);
    if (ready > 0 || (ready < 0 && errno != EINTR)) return true;
    if (!last || ready < 0) continue;
    given_up = true;
    return false;
  }
}

// The bytes of standard input. Grows by realloc(), which moves large blocks without a copy: a
// second block of this size would exceed the limit.
class InputBytes {
 public:
  InputBytes() = default;
  ~InputBytes() { std::free(bytes_); }
  InputBytes(const InputBytes&) = delete;
  InputBytes& operator=(const InputBytes&) = delete;

  std::span<const std::uint8_t> view() const { return {bytes_, size_}; }
  // Reads to the end, or `max_bytes` and one more.
  Status read_all(std::uint64_t max_bytes) {
    while (size_ <= max_bytes) {
      STGS_TRY(wait_for(STDIN_FILENO, POLLIN, "standard input"));
      const std::uint64_t wanted = std::min<std::uint64_t>(kBlock, max_bytes + 1 - size_);
      reserve(size_ + wanted);
      const ssize_t got = ::read(STDIN_FILENO, bytes_ + size_, wanted);
      if (got < 0 && errno != EINTR && errno != EAGAIN)
        return io_error("standard input: cannot read: {}", system_message(errno));
      if (got == 0) return {};
      size_ += static_cast<std::size_t>(std::max<ssize_t>(got, 0));
    }
    return {};
  }

 private:
  void reserve(std::size_t size) {
    if (size <= capacity_) return;
    const std::size_t grown = size + size / 8;
    void* const bytes = std::realloc(bytes_, grown);
    if (bytes == nullptr) throw std::bad_alloc();
    bytes_ = static_cast<std::uint8_t*>(bytes);
    capacity_ = grown;
  }

  std::uint8_t* bytes_ = nullptr;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace

Result<std::span<const std::uint8_t>> read_standard_input(std::uint64_t max_bytes,
                                                          const char* advice) {
  static InputBytes bytes;
  static std::optional<Status> is_read;  // whether that has worked
  if (!is_read) {
    if (::isatty(STDIN_FILENO) != 0) {
      return usage_error("standard input is a terminal; redirect a file to it, or name a file");
    }
    is_read = bytes.read_all(max_bytes);
  }
  if (!is_read->ok()) return *is_read;
  if (bytes.view().size() <= max_bytes) return bytes.view();
  return Status(StatusCode::kLimit,
                fmt::format("standard input: more than {} bytes; {}", max_bytes, advice));
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

void write_standard_error(std::string_view text) {
  while (!text.empty() && wait_for_standard_error()) {
    const ssize_t written = ::write(standard_error, text.data(), std::min(text.size(), kPipeBlock));
    if (written < 0 && errno != EINTR && errno != EAGAIN) return;
    text.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
  }
}

void reserve_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(stream, F_GETFD) >= 0) continue;
    // The lowest free descriptor, which is this one.
    (void)::open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
  }
}

bool is_terminal_standard_error() {
  return ::isatty(standard_error) != 0;
}

void silence_libraries() {
  if (standard_error != STDERR_FILENO) return;
  const int null = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  const int own = null < 0 ? -1 : ::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  if (own >= 0 && ::dup2(null, STDERR_FILENO) == STDERR_FILENO) {
    standard_error = own;
  } else if (own >= 0) {
    ::close(own);
  }
  if (null >= 0) ::close(null);
}

}  // namespace stgs::tools
