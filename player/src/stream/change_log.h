// SPDX-License-Identifier: Apache-2.0
// The items whose state has changed, for those who keep an order of them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stgs::player {

// A log that forgets its beginning: a reader that comes too late looks at all items instead. Not
// thread-safe.
template <typename Item>
class ChangeLog {
 public:
  // Reserves memory for this many changes at least.
  void reserve(std::size_t changes) {
    if (log_.capacity() < changes) log_.reserve(std::max(changes, 2 * log_.capacity()));
  }
  void add(const Item& item) noexcept {
    if (log_.size() == log_.capacity()) forget();
    if (log_.size() < log_.capacity()) log_.push_back(item);
  }
  // Returns the position after the last change.
  std::uint64_t end() const { return begin_ + log_.size(); }
  // Returns the changes from a position on; nothing if some of them are forgotten.
  std::optional<std::span<const Item>> since(std::uint64_t position) const {
    if (position < begin_) return {};
    return std::span(log_).subspan(static_cast<std::size_t>(position - begin_));
  }

 private:
  // Forgets all changes so far, and one that is not added if there is no memory.
  void forget() noexcept {
    begin_ = end() + 1;
    log_.clear();
  }

  std::vector<Item> log_;
  std::uint64_t begin_ = 0;  // position of the first entry
};

}  // namespace stgs::player
