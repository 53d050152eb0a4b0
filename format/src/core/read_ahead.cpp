// SPDX-License-Identifier: Apache-2.0
#include "core/read_ahead.h"

#include <algorithm>

namespace stgs {
namespace {

constexpr std::uint64_t kMaxAhead = 64 << 10;

}  // namespace

Status ReadAhead::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  const std::lock_guard lock(mutex_);
  run_ = (offset == next_ ? run_ : 0) + out.size();
  next_ = offset + out.size();
  if (offset < at_ || next_ > at_ + ahead_.size()) {
    const std::uint64_t size = source_.size();
    const std::uint64_t left = offset < size ? size - offset : 0;
    const std::uint64_t bytes = std::min({run_, kMaxAhead, left});
    if (bytes <= out.size()) return source_.read(offset, out);
    ahead_.resize(static_cast<std::size_t>(bytes));
    if (const Status status = source_.read(offset, ahead_); !status.ok()) {
      ahead_.clear();
      return source_.read(offset, out);  // these bytes alone may be readable
    }
    at_ = offset;
  }
  std::copy_n(ahead_.begin() + static_cast<std::ptrdiff_t>(offset - at_), out.size(), out.begin());
  return {};
}

}  // namespace stgs
