// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "stgs/format/byte_source.h"

namespace stgs::encoder {

// Reads a file through a window, for walks that mostly go forward. One thread at a time.
class FileWindow {
 public:
  static constexpr std::size_t kBytes = 64 << 10;

  // `file` must outlive the object.
  explicit FileWindow(const ByteSource& file) : file_(file) {}

  std::uint64_t size() const { return file_.size(); }
  const std::string& name() const { return file_.name(); }

  // Returns `count` <= kBytes bytes, which last until the next call; fewer at the end of the file.
  Result<std::string_view> bytes(std::uint64_t at, std::size_t count) {
    if (at >= size()) return std::string_view();
    if (at < begin_ || at + count > begin_ + window_.size()) {
      begin_ = at;
      window_.resize(static_cast<std::size_t>(std::min<std::uint64_t>(kBytes, size() - at)));
      STGS_TRY(file_.read(at, window_));
    }
    const std::string_view all(reinterpret_cast<const char*>(window_.data()), window_.size());
    return all.substr(static_cast<std::size_t>(at - begin_), count);
  }
  // Returns an unsigned number of `count` <= 8 bytes, the most significant one first; 0 past the
  // end.
  Result<std::uint64_t> number(std::uint64_t at, std::size_t count) {
    STGS_ASSIGN(const std::string_view text, bytes(at, count));
    std::uint64_t value = 0;
    for (const char c : text) value = value << 8 | static_cast<std::uint8_t>(c);
    return text.size() < count ? 0 : value;
  }

 private:
  const ByteSource& file_;
  std::uint64_t begin_ = 0;
  std::vector<std::uint8_t> window_;
};

}  // namespace stgs::encoder
