// SPDX-License-Identifier: Apache-2.0
// The states of a .4dgs file of the temporal model keyframe-delta.
#pragma once

#include "interchange/fourdgs_file.h"

namespace stgs::fourdgs {

// Composes the states of a file, one chunk after the other.
class Composer {
 public:
  Composer(const ByteSource& source, const Contents& contents, ImportMemory& memory);

  // Reads the chunk `next` of the body with its SH, and advances `next` past them.
  Status read(std::size_t& next);
  // The state of the last chunk, by ascending identity.
  const Population& state() const { return state_; }

 private:
  using Rows = std::vector<std::uint32_t>;

  Status copy(const Population& from, Population& to);
  Result<Lease> take_scratch(std::size_t count);
  bool needs_keyframe(std::size_t next) const;
  Status check_reference(const BodyRecord& record) const;
  Status read_keyframe(const BodyRecord& record, Rows& stated);
  Status read_delta(const BodyRecord& record, Rows& stated);
  Result<std::uint32_t> row_of(std::uint32_t id, const Place& place) const;
  Status update(const Population& changes, const Place& place);
  Status remove(const std::vector<std::uint32_t>& ids, const Place& place);
  Status add(const Population& births, const Place& place, Rows& stated);

  const ByteSource& source_;
  const Contents& contents_;
  ImportMemory& memory_;
  std::size_t sh_bytes_ = 0;  // of one Gaussian
  Population state_, keyframe_;
  std::uint64_t keyframe_at_ = 0;  // offset
  std::optional<BodyRecord> last_;
};

}  // namespace stgs::fourdgs
