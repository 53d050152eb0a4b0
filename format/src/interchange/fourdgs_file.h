// SPDX-License-Identifier: Apache-2.0
// The records of a .4dgs file, except the contents of its chunks.
#pragma once

#include <set>

#include "interchange/fourdgs_format.h"
#include "stgs/format/interchange.h"

namespace stgs::fourdgs {

// A chunk, delta chunk or SH band.
struct BodyRecord {
  std::uint8_t opcode = 0;
  std::uint64_t offset = 0;  // of the record
  std::uint64_t length = 0;  // of its contents
  // Of a chunk or delta chunk:
  double begin = 0, end = 0;  // seconds
  std::uint32_t level = 0;
  std::uint32_t count = 0;  // Gaussians of a chunk, updates of a delta chunk
  // Of a delta chunk:
  bool chained = false;
  std::uint64_t reference = 0, keyframe = 0;  // offsets of records
  std::uint32_t depth = 0, births = 0, deaths = 0;

  bool is_chunk() const { return opcode == kChunk || opcode == kDeltaChunk; }
};

struct CameraRecord {
  double fov_y = 0;  // degrees
  std::array<double, 3> position{}, target{};
  std::uint32_t keyframes = 0;
};

// The axes of the file.
struct FrameRecord {
  bool left_handed = false;
  int up = -1;                 // 0 to 5: +x +y +z -x -y -z; -1: unknown
  double metres_per_unit = 0;  // 0: unknown
};

// Number of records that have no counterpart in a scene.
struct Omitted {
  std::uint64_t audio = 0, attachments = 0, provenance = 0, objects = 0, unknown = 0;
};

struct Contents {
  std::string file;
  std::uint64_t bytes = 0;  // of the file
  Header header;
  Grid grid;
  std::vector<Window> windows;
  std::map<std::string, std::string> metadata;  // of the header and all metadata records
  std::optional<CameraRecord> camera;
  std::optional<FrameRecord> frame;
  std::set<std::uint32_t> moving_objects;  // with a pose that is not the identity
  std::vector<BodyRecord> body;
  Omitted omitted;
  Lease lease;  // of all of these

  bool has_keyframes() const { return header.model == kKeyframes; }
};

// Reads all records but those of the body, and the fixed fields of these. Checks the order and the
// sizes of all records, and the index against the chunks. A wrong checksum of the index becomes a
// note: the index is not used.
Result<Contents> read_contents(const ByteSource& source, ImportMemory& memory,
                               ConversionNotes* notes);

// Reads the contents of a record.
Result<ChargedBytes> read_body(const ByteSource& source, const BodyRecord& record,
                               ImportMemory& memory);
// Returns where a record is, for messages.
inline Place place_of(const Contents& contents, const BodyRecord& record) {
  return {contents.file, record.offset};
}

}  // namespace stgs::fourdgs
