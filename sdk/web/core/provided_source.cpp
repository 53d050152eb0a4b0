// SPDX-License-Identifier: Apache-2.0
#include "provided_source.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include "fetch/other_file.h"

namespace stgs::web {
namespace {

// Bytes read at a time: at least kReadBytes. If a read continues provided bytes, it grows to 1 /
// kReadShare of them, because each attempt to read an index starts over.
constexpr std::uint64_t kReadBytes = 64 << 10, kReadShare = 4;
constexpr std::uint64_t kMaxBytes = 64 << 20;  // provided at a time

}  // namespace

std::span<const std::uint8_t> ProvidedSource::bytes_at(std::uint64_t at) const {
  std::span<const std::uint8_t> best;
  for (auto range = ranges_.begin(); range != ranges_.upper_bound(at); ++range) {
    const std::span<const std::uint8_t> bytes(range->second);
    const std::uint64_t skipped = at - range->first;
    if (skipped + best.size() < bytes.size())
      best = bytes.subspan(static_cast<std::size_t>(skipped));
  }
  return best;
}

bool ProvidedSource::has(std::uint64_t offset, std::uint64_t bytes) const {
  if (ranges_.empty()) return bytes == 0;
  for (std::uint64_t at = offset; at < offset + bytes;) {
    const std::size_t more = bytes_at(at).size();
    if (more == 0) return false;
    at += more;
  }
  return true;
}

Status ProvidedSource::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  STGS_TRY(check_range(name_, size_, offset, out.size()));
  for (std::size_t done = 0; done < out.size();) {
    const std::uint64_t at = offset + done;
    const std::span<const std::uint8_t> bytes = bytes_at(at);
    if (bytes.empty()) {
      const bool continues = at > 0 && !bytes_at(at - 1).empty();
      const std::uint64_t wanted = std::max(kReadBytes, continues ? bytes_ / kReadShare : 0);
      const std::uint64_t more = std::max<std::uint64_t>(
          out.size() - done, std::min(wanted, kMaxBytes - std::min(kMaxBytes, bytes_)));
      return report_missing({at, std::min(more, size_ - at)});
    }
    const std::size_t count = std::min(bytes.size(), out.size() - done);
    std::copy_n(bytes.begin(), count, out.begin() + static_cast<std::ptrdiff_t>(done));
    done += count;
  }
  return {};
}

Status ProvidedSource::report_missing(Range range) const {
  Status failure = std::exchange(failure_, Status());
  if (!failure.ok() && range.offset == failed_at_) return failure;
  if (bytes_ + range.bytes > kMaxBytes) {
    return unsupported(
        "{}: the index needs more than {} MiB at a time, or the file is damaged; download or "
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
    Status status =
        report_missing({0, std::min<std::uint64_t>(player::kMaxComparedHead, stable_bytes)});
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
  charge_.resize(bytes_);
  range.resize(static_cast<std::size_t>(bytes));
  return range;
}

void ProvidedSource::end_read(std::uint64_t offset, std::vector<std::uint8_t> bytes,
                              std::uint64_t file_bytes) {
  if (std::exchange(is_polling_, false)) {
    missing_.reset();
    poll_ = Poll{std::move(bytes), file_bytes};
  } else {
    const std::span<std::uint8_t> to = provide(offset, bytes.size());
    std::copy(bytes.begin(), bytes.end(), to.begin());
  }
}

void ProvidedSource::fail_read(std::uint64_t offset, Status failure) {
  missing_.reset();
  is_polling_ = false;
  failed_at_ = offset;
  failure_ = std::move(failure);
}

void ProvidedSource::clear() {
  if (const auto first = ranges_.find(0); first != ranges_.end() && head_.empty()) {
    const std::size_t bytes = std::min(first->second.size(), player::kMaxComparedHead);
    head_.assign(first->second.begin(), first->second.begin() + static_cast<std::ptrdiff_t>(bytes));
  }
  ranges_.clear();
  bytes_ = 0;
  charge_.resize(0);
}

}  // namespace stgs::web
