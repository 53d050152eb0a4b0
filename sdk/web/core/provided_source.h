// SPDX-License-Identifier: Apache-2.0
// A file whose bytes the page provides, because WebAssembly cannot wait for a read.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/byte_source.h"

namespace stgs::web {

// Reads bytes that the page has provided. A read of other bytes fails with kIo, and is_pending()
// returns true; repeat it once the page has provided missing(). One thread.
class ProvidedSource final : public ByteSource {
 public:
  struct Range {
    std::uint64_t offset = 0, bytes = 0;
  };

  // Charges the provided bytes to the index of `budget`, if given.
  ProvidedSource(std::string name, std::uint64_t size, std::shared_ptr<Budget> budget = nullptr)
      : name_(std::move(name)), size_(size), budget_(std::move(budget)) {
    if (budget_ != nullptr) charge_ = budget_->charge(Budget::Pool::kIndex, 0);
  }

  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return name_; }
  bool may_grow() const override { return true; }
  bool is_pending() const override { return missing_.has_value(); }
  bool has(std::uint64_t offset, std::uint64_t bytes) const override;
  // Discards the provided bytes, because the file may have changed.
  Result<Change> refresh(std::uint64_t stable_bytes) override;
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;

  // Returns the bytes that the last read needs, with some read-ahead.
  const std::optional<Range>& missing() const { return missing_; }
  // Returns memory for the caller to fill with the bytes from `offset` on, which count as provided.
  // Resets missing().
  std::span<std::uint8_t> provide(std::uint64_t offset, std::uint64_t bytes);
  // Ends the read of missing(): with bytes from `offset` on of a file of `file_bytes` bytes, or
  // with a failure.
  void end_read(std::uint64_t offset, std::vector<std::uint8_t> bytes, std::uint64_t file_bytes);
  void fail_read(std::uint64_t offset, Status failure);
  // Frees the provided bytes.
  void clear();

 private:
  // The first bytes of the file and its size, as last read for refresh().
  struct Poll {
    std::vector<std::uint8_t> head;
    std::uint64_t file_bytes = 0;
  };
  // Returns the provided bytes from `at` to the end of a range; empty if there are none.
  std::span<const std::uint8_t> bytes_at(std::uint64_t at) const;
  // Sets missing() to a range and returns a pending error, or the error with which reading it
  // failed.
  Status report_missing(Range range) const;

  const std::string name_;
  std::uint64_t size_;
  const std::shared_ptr<Budget> budget_;
  Lease charge_;                                               // of the provided bytes
  std::vector<std::uint8_t> head_;                             // the first bytes
  std::map<std::uint64_t, std::vector<std::uint8_t>> ranges_;  // by offset; may overlap
  std::uint64_t bytes_ = 0;                                    // of `ranges_`
  bool is_polling_ = false;                                    // missing_ is for refresh()
  std::optional<Poll> poll_;
  mutable std::optional<Range> missing_;
  mutable Status failure_;  // of reading the bytes at failed_at_
  std::uint64_t failed_at_ = 0;
};

}  // namespace stgs::web
