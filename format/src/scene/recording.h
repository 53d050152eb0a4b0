// SPDX-License-Identifier: Apache-2.0
// The complete content of a recording on disk (spec 9), for resuming and finalizing it.
#pragma once

#include <cstdint>
#include <vector>

#include "container/node.h"
#include "stgs/format/damage_report.h"

namespace stgs {

// The links that the next FRAG record contains. A fragment whose number is a multiple of a power of
// 16 takes the links of all fragments since the multiple before into its node, so that few links
// are left (spec 9.3).
class FragmentLinks {
 public:
  FragmentLinks() = default;
  // Resumes a recording that was read completely.
  explicit FragmentLinks(const FileHead& head);

  // Adds the links to those of the node and the earlier ones of the next fragment.
  void take(FragmentRecord& next) const;
  // Adds a fragment that was written, whose links are those of the last take().
  void add(const FragmentRecord& fragment);

 private:
  struct Link {
    NodeLink link;
    std::uint64_t number = 0;  // of the fragment that it leads to, from 1
    int depth = 1;             // greatest number of links that follow each other from here
  };
  // Returns whether the next fragment takes a link into its node.
  bool is_taken(const Link& link) const;

  std::vector<Link> links_;  // to all fragments, each directly or through others
  std::uint64_t count_ = 0;
};

// Reads the stored bytes of a record and verifies them.
bool copy_record(const ByteSource& source, const RecordRange& record,
                 std::vector<std::uint8_t>& bytes, Findings& findings);

// Reads the complete content of a recording that is to be resumed. kUsage if it is finished,
// kInvalidFile if its index is damaged.
Result<FileHead> read_resumable(const ByteSource& source);
// Reads the complete content of a recording, without a last fragment of which no record reached the
// disk. `report` receives the problems found when opening, and the segments of that fragment.
// kUsage if the file is not a recording.
Result<FileHead> read_recording(const ByteSource& source, const ReadLimits& limits,
                                DamageReport& report);

}  // namespace stgs
