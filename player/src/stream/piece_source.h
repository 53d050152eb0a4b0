// SPDX-License-Identifier: Apache-2.0
// A source whose pieces are fetched by somebody else, before they are read.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <memory_resource>
#include <mutex>
#include <span>
#include <vector>

#include "stgs/format/byte_source.h"

namespace stgs::player {

// Reads pieces that were put there from memory, and all else from `under`. Thread-safe.
class RangeSource final : public ByteSource {
 public:
  // `memory`: of the pieces.
  RangeSource(std::unique_ptr<ByteSource> under, std::pmr::memory_resource* memory)
      : under_(std::move(under)), memory_(memory) {}

  std::uint64_t size() const override { return under_->size(); }
  const std::string& name() const override { return under_->name(); }
  bool may_grow() const override { return under_->may_grow(); }
  Result<Change> refresh(std::uint64_t kept) override { return under_->refresh(kept); }
  void set_finished() override { under_->set_finished(); }
  bool has_shrunk() const override { return under_->has_shrunk(); }
  bool was_modified() const override { return under_->was_modified(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;

  // Reads a piece that is to be put there, as long as it is wanted (read_while()): what recent()
  // was told of is not read again. `read` tells whether it was.
  Status fetch(const std::function<bool()>& should_continue, std::uint64_t offset,
               std::span<std::uint8_t> out, bool& read) const;
  // Bytes that were read for something else, some 64 kB: the last few are kept.
  void recent(std::uint64_t offset, std::span<const std::uint8_t> bytes);
  // Keeps the last alone: those before are of what the file is no more.
  void forget_recent();
  void put(std::uint64_t offset, std::span<const std::uint8_t> bytes);
  void drop(std::uint64_t offset);

 private:
  using Bytes = std::shared_ptr<const std::pmr::vector<std::uint8_t>>;

  std::unique_ptr<ByteSource> under_;
  std::pmr::memory_resource* memory_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, Bytes> pieces_;  // by offset
  std::deque<std::pair<std::uint64_t, std::vector<std::uint8_t>>> recent_;
};

}  // namespace stgs::player
