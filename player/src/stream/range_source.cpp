// SPDX-License-Identifier: Apache-2.0
#include "stream/range_source.h"

#include <algorithm>

namespace stgs::player {
namespace {

constexpr std::size_t kMaxRecent = 4;

}  // namespace

Status RangeSource::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  if (interrupted_.load(std::memory_order_relaxed)) return io_error("{}: closed", name());
  Bytes bytes;
  std::uint64_t begin = 0;
  {
    const std::lock_guard lock(mutex_);
    auto after = ranges_.upper_bound(offset);
    if (after != ranges_.begin()) {
      begin = std::prev(after)->first;
      bytes = std::prev(after)->second;
    }
  }
  if (bytes == nullptr || offset - begin > bytes->size() ||
      out.size() > bytes->size() - (offset - begin)) {
    return under_->read(offset, out);
  }
  std::copy_n(bytes->begin() + static_cast<std::ptrdiff_t>(offset - begin), out.size(),
              out.begin());
  return {};
}

Status RangeSource::fetch(const std::function<bool()>& should_continue, std::uint64_t offset,
                          std::span<std::uint8_t> out, bool& read) const {
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [begin, bytes, charge] : recent_) {
      if (offset < begin || offset - begin > bytes.size() ||
          out.size() > bytes.size() - (offset - begin)) {
        continue;
      }
      std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(offset - begin), out.size(),
                  out.begin());
      read = false;
      return {};
    }
  }
  read = true;
  return under_->read_while(should_continue, offset, out);
}

void RangeSource::add_recent(std::uint64_t offset, std::span<const std::uint8_t> bytes) {
  Recent recent{offset, {bytes.begin(), bytes.end()}, {}};
  if (budget_ != nullptr) recent.charge = budget_->charge(Budget::Pool::kTransfers, bytes.size());
  const std::lock_guard lock(mutex_);
  recent_.push_back(std::move(recent));
  if (recent_.size() > kMaxRecent) recent_.pop_front();
}

void RangeSource::forget_recent() {
  const std::lock_guard lock(mutex_);
  while (recent_.size() > 1) recent_.pop_front();
}

void RangeSource::insert(std::uint64_t offset, std::span<const std::uint8_t> bytes) {
  auto shared =
      std::make_shared<const std::pmr::vector<std::uint8_t>>(bytes.begin(), bytes.end(), memory_);
  const std::lock_guard lock(mutex_);
  ranges_[offset] = std::move(shared);
}

void RangeSource::erase(std::uint64_t offset) {
  Bytes removed;  // freed after the mutex is unlocked
  const std::lock_guard lock(mutex_);
  const auto found = ranges_.find(offset);
  if (found == ranges_.end()) return;
  removed = std::move(found->second);
  ranges_.erase(found);
}

}  // namespace stgs::player
