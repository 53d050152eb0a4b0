// SPDX-License-Identifier: Apache-2.0
#include "standard_input.h"

#include <unistd.h>

#include <cerrno>
#include <vector>

namespace stgs::tools {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 20;  // bytes per read

Status read_all(std::vector<std::uint8_t>& bytes) {
  for (;;) {
    const std::size_t size = bytes.size();
    bytes.resize(size + kBlock);
    const ssize_t got = ::read(STDIN_FILENO, bytes.data() + size, kBlock);
    if (got < 0 && errno == EINTR) {
      bytes.resize(size);
      continue;
    }
    bytes.resize(size + static_cast<std::size_t>(got > 0 ? got : 0));
    if (got < 0) return io_error("standard input: cannot read: {}", system_message(errno));
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

}  // namespace stgs::tools
