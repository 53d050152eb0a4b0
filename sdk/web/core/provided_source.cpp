// SPDX-License-Identifier: Apache-2.0
#include "provided_source.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include "fetch/other_file.h"

namespace stgs::web {
namespace {

// Bytes read at a time: at least so many, and this share of those that are provided, since each
// attempt to read an index looks at all of them.
constexpr std::uint64_t kReadBytes = 64 << 10, kReadShare = 4;
constexpr std::uint64_t kMaxBytes = 64 << 20;  // provided at a time

}  // namespace

Status ProvidedSource::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  STGS_TRY(check_range(name_, size_, offset, out.size()));
  std::uint64_t at = offset;
  const std::uint64_t end = offset + out.size();
  while (at < end) {
    // The range with the most bytes from `at` on.
    const std::vector<std::uint8_t>* best = nullptr;
    std::uint64_t best_at = 0, best_end = at;
    for (auto range = ranges_.begin(); range != ranges_.upper_bound(at); ++range) {
      const std::uint64_t range_end = range->first + range->second.size();
      if (range_end <= best_end) continue;
      best = &range->second;
      best_at = range->first;
      best_end = range_end;
    }
    if (best == nullptr) {
      const std::uint64_t more = std::max({end - at, kReadBytes, bytes_ / kReadShare});
      return lack({at, std::min(more, size_ - at)});
    }
    const std::uint64_t bytes = std::min(end, best_end) - at;
    std::copy_n(best->begin() + static_cast<std::ptrdiff_t>(at - best_at), bytes,
                out.begin() + static_cast<std::ptrdiff_t>(at - offset));
    at += bytes;
  }
  return {};
}

Status ProvidedSource::lack(Range range) const {
  if (!failure_.ok()) return std::exchange(failure_, Status());
  if (bytes_ + range.bytes > kMaxBytes) {
    return invalid_file(
        "{}: the index takes more than {} MiB at a time, or the file is damaged; download or "
        "repair it ('stgs finalize')",
        name_, kMaxBytes >> 20);
  }
  missing_ = range;
  return io_error("{}: {} bytes at {} have not arrived", name_, range.bytes, range.offset);
}

Result<ByteSource::Change> ProvidedSource::refresh(std::uint64_t stable_bytes) {
  if (!poll_) {
    clear();
    // The file may have changed beyond `stable_bytes`.
    if (head_.size() > stable_bytes) head_.resize(static_cast<std::size_t>(stable_bytes));
    Status status = lack({0, std::min<std::uint64_t>(player::kMaxComparedHead, stable_bytes)});
    is_polling_ = is_pending();
    return status;
  }
  const Poll poll = *std::exchange(poll_, std::nullopt);
  if (player::is_other_file(head_, stable_bytes, poll.head, poll.file_bytes))
    return Change::kReplaced;
  return std::exchange(size_, poll.file_bytes) == poll.file_bytes ? Change::kNone
                                                                  : Change::kResized;
}

std::span<std::uint8_t> ProvidedSource::provide(std::uint64_t offset, std::uint64_t bytes) {
  missing_.reset();
  size_ = std::max(size_, offset + bytes);
  std::vector<std::uint8_t>& range = ranges_[offset];
  bytes_ += bytes - range.size();
  range.resize(static_cast<std::size_t>(bytes));
  return range;
}

void ProvidedSource::end_read(std::vector<std::uint8_t> bytes, std::uint64_t file_bytes) {
  if (!missing_) return;
  if (std::exchange(is_polling_, false)) {
    missing_.reset();
    poll_ = Poll{std::move(bytes), file_bytes};
  } else {
    const std::span<std::uint8_t> to = provide(missing_->offset, bytes.size());
    std::copy(bytes.begin(), bytes.end(), to.begin());
  }
}

void ProvidedSource::fail_read(Status failure) {
  missing_.reset();
  is_polling_ = false;
  failure_ = std::move(failure);
}

void ProvidedSource::clear() {
  if (const auto first = ranges_.find(0); first != ranges_.end() && head_.empty()) {
    const std::size_t bytes = std::min(first->second.size(), player::kMaxComparedHead);
    head_.assign(first->second.begin(), first->second.begin() + static_cast<std::ptrdiff_t>(bytes));
  }
  ranges_.clear();
  bytes_ = 0;
}

}  // namespace stgs::web
