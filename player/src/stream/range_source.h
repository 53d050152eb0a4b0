// SPDX-License-Identifier: Apache-2.0
// A byte source with prefetched ranges.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <memory_resource>
#include <mutex>
#include <span>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/byte_source.h"

namespace stgs::player {

// Serves prefetched ranges from memory, and all other reads from the underlying source.
// Thread-safe.
class RangeSource final : public ByteSource {
 public:
  // `memory` allocates the prefetched ranges. `budget`, if given, is charged for the recent bytes;
  // the user charges the prefetched ones.
  RangeSource(std::unique_ptr<ByteSource> under, std::pmr::memory_resource* memory,
              std::shared_ptr<Budget> budget = nullptr)
      : under_(std::move(under)), memory_(memory), budget_(std::move(budget)) {}

  std::uint64_t size() const override { return under_->size(); }
  const std::string& name() const override { return under_->name(); }
  bool may_grow() const override { return under_->may_grow(); }
  Result<Change> refresh(std::uint64_t stable_bytes) override {
    return under_->refresh(stable_bytes);
  }
  void set_finished() override { under_->set_finished(); }
  bool has_shrunk() const override { return under_->has_shrunk(); }
  bool was_modified() const override { return under_->was_modified(); }
  bool is_pending() const override { return under_->is_pending(); }
  bool has(std::uint64_t offset, std::uint64_t bytes) const override {
    return under_->has(offset, bytes);
  }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;

  // Lets read() fail from now on.
  void interrupt() noexcept { interrupted_.store(true, std::memory_order_relaxed); }
  // Reads a range that is to be inserted, for as long as should_continue() is true (read_while()).
  // Bytes that add_recent() was given are not read again. Sets `read` to whether the underlying
  // source was read.
  Status fetch(const std::function<bool()>& should_continue, std::uint64_t offset,
               std::span<std::uint8_t> out, bool& read) const;
  // Retains bytes that were read for another purpose, about 64 kB. The last few are retained.
  void add_recent(std::uint64_t offset, std::span<const std::uint8_t> bytes);
  // Discards all recent bytes but the last: the others are from an earlier version of the file.
  void forget_recent();
  // Inserts a prefetched range, or replaces the one at that offset.
  void insert(std::uint64_t offset, std::span<const std::uint8_t> bytes);
  // Removes the prefetched range at that offset, if any.
  void erase(std::uint64_t offset);

 private:
  using Bytes = std::shared_ptr<const std::pmr::vector<std::uint8_t>>;
  struct Recent {
    std::uint64_t offset = 0;
    std::vector<std::uint8_t> bytes;
    Lease charge;
  };

  std::unique_ptr<ByteSource> under_;
  std::pmr::memory_resource* memory_;
  const std::shared_ptr<Budget> budget_;
  std::atomic<bool> interrupted_ = false;
  mutable std::mutex mutex_;               // guards the following members
  std::map<std::uint64_t, Bytes> ranges_;  // by offset
  std::deque<Recent> recent_;
};

}  // namespace stgs::player
