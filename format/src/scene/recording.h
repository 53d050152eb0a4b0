// SPDX-License-Identifier: Apache-2.0
// The complete content of a recording on disk (spec 5.12), for resuming and finalizing it.
#pragma once

#include <cstdint>
#include <vector>

#include "container/container.h"
#include "stgs/format/damage_report.h"

namespace stgs {

// The data of one append: segment records followed by the FRAG record that lists them.
struct Fragment {
  PartEntry part;
  std::vector<SegmentEntry> segments;  // of part 0
  std::vector<AttributeBytes> attributes;
  std::uint64_t primitives = 0;
  std::uint64_t record_offset = 0, record_bytes = 0;  // of its FRAG record
};

// Returns the complete fragments of a recording. Attribute totals are exact for each FRAG record of
// the index: of the fragments it lists, the first has the total and the others have zeros.
std::vector<Fragment> fragments_of(const FileHead& head);

// Reads the stored bytes of a record and verifies them.
bool copy_record(const ByteSource& source, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings);

// Reads the complete content of a recording that is to be resumed. kUsage if it is finished,
// kInvalidFile if its index is damaged, kUnsupported if another program laid it out.
Result<FileHead> read_resumable(const ByteSource& source);
// Reads the complete content of a recording, without a last fragment of which no record reached the
// disk. `report` receives the problems found when opening, and the segments of that fragment.
// kUsage if the file is not a recording.
Result<FileHead> read_recording(const ByteSource& source, DamageReport& report);

}  // namespace stgs
