// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <vector>

#include "stgs/format/byte_source.h"

namespace stgs {

// Reads ahead in another source while reads are sequential: each read that continues the previous
// one doubles the read-ahead, up to 64 KiB. In any order, at most twice the requested bytes are
// read. Borrows the source.
class ReadAhead final : public ByteSource {
 public:
  explicit ReadAhead(const ByteSource& source) : source_(source) {}

  std::uint64_t size() const override { return source_.size(); }
  const std::string& name() const override { return source_.name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;

 private:
  const ByteSource& source_;
  mutable std::mutex mutex_;  // guards the members below
  mutable std::vector<std::uint8_t> ahead_;
  mutable std::uint64_t at_ = 0;    // of `ahead_`
  mutable std::uint64_t next_ = 0;  // end of the last read
  mutable std::uint64_t run_ = 0;   // bytes read in order up to there
};

}  // namespace stgs
