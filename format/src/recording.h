// SPDX-License-Identifier: Apache-2.0
// What is complete of a recording on disk (spec 5.12), for going on with it and for finishing it.
#pragma once

#include <cstdint>
#include <vector>

#include "container.h"
#include "stgs/format/damage_report.h"

namespace stgs {

// What the index tells of an appended stretch.
struct Stretch {
  PartEntry part;
  std::vector<SegmentEntry> segments;  // of part 0
  std::vector<AttributeBytes> attributes;
  std::uint64_t primitives = 0;
  std::uint64_t fragment = 0, fragment_bytes = 0;  // its FRAG record
};

// What a recorder knew when it had written these complete fragments. Of attributes it is enough to
// know what each fragment of the index lists: a later one lists several of them, or none.
std::vector<Stretch> stretches_of(const FileHead& head);

// The stored bytes of a record, checked.
bool copy_record(const ByteSource& source, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings);

// What is complete of a recording that is to be gone on with: kUsage where it is finished,
// kInvalidFile where its index is damaged, kUnsupported where another program laid it out.
Result<FileHead> read_resumable(const ByteSource& source);
// What is complete of a recording, without a last fragment none of whose records reached the disk;
// `losses` receives what opening it finds, and that fragment's segments. kUsage where the file is
// no recording.
Result<FileHead> read_recording(const ByteSource& source, DamageReport& losses);

}  // namespace stgs
