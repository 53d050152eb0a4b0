// SPDX-License-Identifier: Apache-2.0
// The most urgent of many items, without visiting all of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace stgs::player {

// A tournament of slots: each has a deadline, seconds, and a rank that decides between equal
// deadlines, the lower one first. Not thread-safe.
class UrgencyTree {
 public:
  static constexpr double kAbsent = std::numeric_limits<double>::infinity();
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  struct Key {
    double deadline = kAbsent;
    std::size_t rank = 0;

    bool comes_before(const Key& other) const {
      return deadline < other.deadline || (deadline == other.deadline && rank < other.rank);
    }
  };

  // Replaces all slots, in linear time. If this throws, nothing has changed.
  void assign(std::vector<Key> keys) {
    const std::size_t count = keys.size();
    std::vector<std::uint32_t> winners(2 * count);
    keys_ = std::move(keys);
    winners_ = std::move(winners);
    for (std::size_t i = 0; i < count; ++i) winners_[count + i] = static_cast<std::uint32_t>(i);
    for (std::size_t i = count; i-- > 1;) play(i);
  }
  std::size_t size() const { return keys_.size(); }
  const Key& key(std::size_t slot) const { return keys_[slot]; }
  // Sets the deadline of a slot; kAbsent removes it. Takes O(log n).
  void set(std::size_t slot, double deadline) noexcept {
    if (keys_[slot].deadline == deadline) return;
    keys_[slot].deadline = deadline;
    for (std::size_t i = (slot + size()) / 2; i > 0; i /= 2) play(i);
  }
  // Returns the most urgent of the first `count` slots; kNone: all are absent. Takes O(log n).
  std::size_t first(std::size_t count) const noexcept {
    if (count == 0) return kNone;
    std::uint32_t best = 0;
    for (std::size_t low = size(), high = low + count; low < high; low /= 2, high /= 2) {
      if (low % 2 == 1) best = better(best, winners_[low++]);
      if (high % 2 == 1) best = better(best, winners_[--high]);
    }
    return keys_[best].deadline < kAbsent ? best : kNone;
  }

 private:
  std::uint32_t better(std::uint32_t a, std::uint32_t b) const noexcept {
    return keys_[b].comes_before(keys_[a]) ? b : a;
  }
  void play(std::size_t node) noexcept {
    winners_[node] = better(winners_[2 * node], winners_[2 * node + 1]);
  }

  std::vector<Key> keys_;
  // Node i > 0 has the winner of its children 2i and 2i + 1; the slots follow the inner nodes.
  std::vector<std::uint32_t> winners_;
};

}  // namespace stgs::player
