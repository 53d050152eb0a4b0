// SPDX-License-Identifier: Apache-2.0
// A recording as a file with its index in the head.
#include <exception>

#include "recording.h"
#include "scene_write.h"
#include "stgs/format/output_file.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {
namespace {

Status finalize(const ByteSource& source, const std::string& output) {
  STGS_ASSIGN(FileHead head, read_recording(source));
  for (PartEntry& part : head.parts) part.skip = 0;
  const std::vector<IndexEntry*> records = records_of(head.index.segments);
  std::uint64_t body_bytes = 0;
  for (const IndexEntry* record : records) body_bytes += record->bytes;
  FileHeader header;
  OutputFile file;
  STGS_TRY(file.open(output));
  STGS_TRY(file.write(write_finished_head(
      head.metadata, head.layouts, write_index(head.index, head.parts), body_bytes, header)));
  std::vector<std::uint8_t> bytes;
  Findings findings;
  for (const IndexEntry* record : records) {
    if (!copy_record(source, *record, bytes, findings)) return findings.status(source.name());
    STGS_TRY(file.write(bytes));
  }
  return file.commit();
}

}  // namespace

Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output) {
  try {
    return finalize(*recording, output);
  } catch (const std::exception& e) {
    return runtime_error("{}: {}", recording->name(), e.what());
  }
}

}  // namespace stgs
